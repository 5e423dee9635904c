"""Called by `.ci/wheel` with the environment of an installed wheel: a run in lockstep, and the page with its charts."""

import json
import subprocess
import sys
import time
import urllib.request
from importlib.util import find_spec
from pathlib import Path

_HIL = [sys.executable, "-m", "hil"]
_CHARTS = ("uPlot.esm.js", "uPlot.min.css")


def run_in_lockstep() -> str:
    """One line on an emulated run of the shipped example. Raises SystemExit where it is not good."""
    command = [*_HIL, "run", "s-slow", "--link", "inproc:s-slow", "--clock", "lockstep", "--json"]
    begin = time.monotonic()
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    if ended.returncode != 0:
        sys.exit(f"wheel: hil run ended with {ended.returncode}: {ended.stderr[-2000:]}")
    verdict = json.loads(ended.stdout)["verdict"]
    return f"wheel: the first hil run took {time.monotonic() - begin:.1f} s and is {verdict}"


def page_with_charts() -> str:
    """One line on the files of the page. Raises SystemExit where one is absent."""
    package = find_spec("hil")
    assert package is not None
    assert package.origin is not None
    vendor = Path(package.origin).parent / "service" / "page" / "vendor"
    service = subprocess.Popen([*_HIL, "serve", "--port", "0"], stdout=subprocess.PIPE, text=True)
    try:
        assert service.stdout is not None
        line = service.stdout.readline()
        url = next(word for word in line.split() if word.startswith("http")).partition("?")[0].partition("#")[0]
        for name in _CHARTS:
            with urllib.request.urlopen(f"{url.rstrip('/')}/vendor/{name}", timeout=30) as answer:
                if answer.read() != (vendor / name).read_bytes():
                    sys.exit(f"wheel: the page has no whole {name}; python fetch_page.py")
    finally:
        service.terminate()
        service.wait(timeout=60)
    return "wheel: the page has its charts"


print(run_in_lockstep(), flush=True)
print(page_with_charts())
