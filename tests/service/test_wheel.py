"""A wheel draws the charts of the page: what it is built from, what it holds, what a service from it hands out."""

import os
import shutil
import subprocess
import sys
import urllib.request
import zipfile
from pathlib import Path

import pytest

import fetch_page

ROOT = Path(__file__).parents[2]


def test_what_the_page_lacks_is_known_and_copied(tmp_path: Path) -> None:
    package, vendor = tmp_path / "node_modules" / "uplot", tmp_path / "vendor"
    for name in fetch_page.FILES:
        (package / name).parent.mkdir(parents=True, exist_ok=True)
        (package / name).write_text(name, encoding="utf-8")
    assert fetch_page.missing(vendor) == list(fetch_page.FILES.values())
    fetch_page.copy(tmp_path / "node_modules", vendor)
    assert fetch_page.missing(vendor) == []
    assert (vendor / "uPlot.esm.js").read_text(encoding="utf-8") == "dist/uPlot.esm.js"


def test_a_build_that_cannot_have_them_ends_with_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fetch_page, "_NPM", "import sys; sys.exit(1)")
    with pytest.raises(SystemExit) as ended:
        fetch_page.fetch(tmp_path / "vendor")
    assert "would have no charts" in str(ended.value)
    assert "make install" in str(ended.value)
    assert "\n" not in str(ended.value)


@pytest.mark.long
@pytest.mark.timeout(600)
def test_a_wheel_of_the_tracked_files_serves_its_charts(tmp_path: Path) -> None:
    """Built from what git tracks and no `make` has touched, installed alone, and asked for its files."""
    source, wheels, target = tmp_path / "source", tmp_path / "wheels", tmp_path / "target"
    tracked = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    for name in filter(None, tracked.split("\0")):
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / name, source / name)
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet"]
    subprocess.run([*pip, "wheel", "--no-deps", "--wheel-dir", str(wheels), str(source)], check=True)
    (wheel,) = wheels.glob("*.whl")
    names = zipfile.ZipFile(wheel).namelist()
    assert {f"hil/service/page/vendor/{name}" for name in fetch_page.FILES.values()} <= set(names)
    subprocess.run([*pip, "install", "--no-deps", "--target", str(target), str(wheel)], check=True)
    place = {**os.environ, "PYTHONPATH": str(target)}
    (tmp_path / "bench").mkdir()
    process = subprocess.Popen(
        [sys.executable, "-m", "hil", "serve", "--port", "0"],
        cwd=tmp_path / "bench", env=place, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        url = next(word for word in line.split() if word.startswith("http")).partition("?")[0].partition("#")[0]
        for name in ("uPlot.esm.js", "uPlot.min.css"):
            with urllib.request.urlopen(f"{url.rstrip('/')}/vendor/{name}", timeout=30) as answer:
                assert answer.read() == (target / "hil" / "service" / "page" / "vendor" / name).read_bytes()
    finally:
        process.terminate()
        process.communicate(timeout=60)
