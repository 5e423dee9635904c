"""`make test-vcan`: the tests of this folder on a virtual CAN interface, wherever one can be had.

Where the kernel has none, user-mode Linux brings one (`tests.vcan.virtual_can`), in about a minute.  Where there is
neither, the tests are skipped with the reason, unless HIL_REQUIRE_VCAN=1 says that they may not be.  Further arguments
go to pytest.
"""

import os
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import hil
from tests.vcan.virtual_can import NotHere, with_vcan

PYTEST = (sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-p", "tests.vcan.without_mf4")
TREE = Path(__file__).parents[2]
PATIENCE_S = 900.0  # one processor, imports ten times slower; three times what it took on a quiet machine


def main(arguments: list[str]) -> int:
    """Exit code of pytest, or 0 where the tests had to be skipped."""
    with tempfile.TemporaryDirectory(prefix="vcan-") as place:
        environment = {**os.environ, "HIL_PTY_BOARD": build(Path(place)), "OPENBLAS_NUM_THREADS": "1"}
        command = [*PYTEST, str(Path(__file__).parent), *arguments]
        try:
            return with_vcan(command, environment, Path(place), PATIENCE_S)
        except NotHere as reason:
            required = os.environ.get("HIL_REQUIRE_VCAN") == "1"
            print(f"tests on vcan: {'missing' if required else 'skipped'}: {reason}", file=sys.stderr)
            return int(required)


def build(place: Path) -> str:
    """The C board with the estimator of c-board-own, for the machine at hand and the one inside alike; "" without a
    compiler.
    """
    if shutil.which("make") is None or shutil.which("cc") is None:
        return ""
    keep = {name: value for name, value in os.environ.items() if name not in ("MAKEFLAGS", "MFLAGS", "MAKELEVEL")}
    hil.generate("c-board-own", out=place / "estimator", sense_scale=0.25 / 2**15)
    where = [f"BUILD={place}/firmware", f"ESTIMATOR={place}/estimator"]
    subprocess.run(["make", "--silent", "-C", str(TREE / "firmware"), *where, "all"], check=True, env=keep)
    return f"{place}/firmware/pty_board"


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # by way of an exception, which ends what was started
    sys.exit(main(sys.argv[1:]))
