"""A browser, a service and a board. Each test has a service of its own where it changes what others would see."""

import os
import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect, sync_playwright

from hil.bench.examples import find
from hil.service.app import lacking
from tests.browser.bench_page import LOCKSTEP, PATIENT, BenchPage
from tests.service.serving import Serving, serving

_LIMITS = """[limits]
late_fraction = 1.0
lost_fraction = 1.0
invalid_fraction = 1.0
residual_safe = 1e9
rearm = 1000
"""
_REQUIRED = "HIL_REQUIRE_BROWSER"
"""Set where these tests may not be left out."""


def _chromium() -> str:
    found = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    missing = "no chromium: sudo apt install chromium" if found is None else lacking()
    if missing and not os.environ.get(_REQUIRED):
        pytest.skip(missing)
    assert not missing, missing
    assert found is not None
    return found


@pytest.fixture(scope="package")
def browser() -> Iterator[Browser]:
    """The system's chromium, without a window."""
    path = _chromium()
    options = ["--no-sandbox"] if os.geteuid() == 0 else []  # it refuses to be root with one
    expect.set_options(timeout=60_000)  # of a machine that does other things; how soon: python -m benchmarks service
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=path, args=options)
        yield chromium
        chromium.close()


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Serving]:
    """A service with an empty folder, beside which the bench files `PATIENT` and `LOCKSTEP` lie."""
    folder = tmp_path_factory.mktemp("bench")
    text = find("bench", "s-slow").read_text()
    (folder / f"{PATIENT}.bench.toml").write_text(_patient(text))
    (folder / f"{LOCKSTEP}.bench.toml").write_text(_replaced(text, r'^clock = "paced"$', 'clock = "lockstep"'))
    with serving(folder / "runs") as running:
        yield running


def _patient(text: str) -> str:
    """S-slow on the clock on the wall, for a machine that does other things as well: a stall of it ends no run."""
    text = _replaced(text, r"^watchdog_s = .*$", "watchdog_s = 0.5")
    return _replaced(text, r"^\[limits\]\n(?:.+\n?)*", _LIMITS)


def _replaced(text: str, old: str, new: str) -> str:
    text, changed = re.subn(old, new, text, flags=re.MULTILINE)
    assert changed == 1
    return text


@pytest.fixture
def page(browser: Browser, service: Serving) -> Iterator[BenchPage]:
    """The page of `service`, opened by the address that it printed; what it complains of fails the test."""
    with BenchPage.opened(browser, service) as shown:
        yield shown


@pytest.fixture(scope="package")
def pictures() -> Path:
    """Where screenshots are kept: git does not look at it."""
    folder = Path("runs/page")
    folder.mkdir(parents=True, exist_ok=True)
    return folder
