"""What every test run needs before anything is imported."""

import gc
import os
import re
import signal
from collections import Counter, defaultdict
from collections.abc import Generator, Iterable, Iterator
from contextlib import nullcontext
from pathlib import Path

import pytest
from hypothesis import settings

from tests.by_the_clock import Floor

# The matrices here are 13 × 13: threads of the BLAS library only wait for each other, hundreds of times longer on a
# busy machine.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

gc.disable()  # until all files are loaded, of which nothing is garbage

# What runs behind a shell has Ctrl-C ignored, and hands that on to the processes that tests interrupt.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# How long an example takes says how busy the machine is, not whether the code is right.
settings.register_profile("any machine", deadline=None)
settings.load_profile("any machine")


_WHOLLY = {
    name: re.compile(rf"^pytestmark = (?:\[[^\]]*)?pytest\.mark\.(?:{marks})\b", re.MULTILINE)
    for name, marks in {"not slow": "slow|long", "not long": "long"}.items()
}
_MARKED = {"realtime": "realtime", "long": "(?:long|beyond)"}
_LONG_S = 20.0
_SLOW_S = 2.0
_QUICK_S = 0.1
_FLOOR = pytest.StashKey[Floor]()


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """A file of which `-m` leaves nothing is not even loaded, by each of the processes: its text says so."""
    if not collection_path.match("test_*.py"):
        return None
    wanted, text = config.getoption("markexpr").split(" and "), collection_path.read_text(encoding="utf-8")
    left_out = any(mark in wanted and wholly.search(text) for mark, wholly in _WHOLLY.items())
    lacking = any(mark in wanted and not re.search(rf"mark\.{pattern}\b", text) for mark, pattern in _MARKED.items())
    return True if left_out or lacking else None


@pytest.fixture(scope="session")
def whole_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a real run with its report, for all tests that leave it as it is."""
    from tests.service.folders import shared_run  # loads the bench, which most files of tests do without

    return shared_run(tmp_path_factory)


@pytest.fixture(autouse=True)
def _forked(request: pytest.FixtureRequest) -> Iterator[None]:
    """Where no clock counts, processes of ours are forks of this one, once this one has loaded what starts them."""
    if request.node.get_closest_marker("realtime"):
        yield
        return
    from tests.forked import forking

    with forking():
        yield


@pytest.fixture
def no_report(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leaves out the page for people, which costs more than the short run it tells of."""

    def written(_: Path) -> None:
        pass

    monkeypatch.setattr("hil.report.page.write_report", written)
    monkeypatch.setattr("hil.running.concluding.artist", lambda _: nullcontext())


@pytest.fixture(scope="module")
def no_sizes() -> Iterator[None]:
    """Leaves out the bytes of what is generated: its compiler for a Cortex-M7 takes four fifths of the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("hil.generating.c_code.sizes", lambda _: None)
        yield


@pytest.fixture
def no_scan(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leaves out the scan that closes a run, where nobody asks whether the model is complete."""

    def scanned(*_: object) -> None:
        pass

    monkeypatch.setattr("hil.running.closing_scan.scan_run", scanned)


def pytest_itemcollected(item: pytest.Item) -> None:
    """Who stands on a whole run takes what that takes."""
    if "whole_run" in getattr(item, "fixturenames", ()):
        item.add_marker(pytest.mark.moderate)


def pytest_collection_finish() -> None:
    """What is loaded stays, and is looked through for garbage no more: here, and in forks."""
    gc.freeze()
    gc.enable()


@pytest.hookimpl(wrapper=True, tryfirst=True)  # marks before `-m` chooses by them, order of what it has left
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> Generator[None]:
    """Says what is long; and where files run side by side, those that may take longest begin first, by the marks of
    their tests.

    The last file to begin decides when all have ended, and xdist by itself begins with those of the most tests: a
    single test of four minutes would come last.
    """
    mark_long(items)
    yield
    if not hasattr(config, "workerinput"):
        return
    config.stash[_FLOOR] = floor = Floor(config.workerinput["testrunuid"])
    floor.note(items)
    may_take: defaultdict[Path, float] = defaultdict(float)
    for item in items:
        may_take[item.path] += _may_take(item)
    items.sort(key=lambda item: -may_take[item.path])


def mark_long(items: Iterable[pytest.Item]) -> None:
    """Of a test whose cases are long beyond some, the first stay; what is long is slow as well."""
    cases: Counter[str] = Counter()
    for item in items:
        if beyond := item.get_closest_marker("beyond"):
            test = item.nodeid.partition("[")[0]
            cases[test] += 1
            if cases[test] > beyond.args[0]:
                item.add_marker(pytest.mark.long)
        if item.get_closest_marker("long"):
            item.add_marker(pytest.mark.slow)


def _may_take(item: pytest.Item) -> float:
    """Seconds, roughly: a test that was given more time than usual says so itself."""
    own = item.get_closest_marker("timeout")
    if own is not None:
        return float(own.args[0]) / 5.0
    if item.get_closest_marker("long"):
        return _LONG_S
    return _SLOW_S if item.get_closest_marker("slow") else _QUICK_S


@pytest.hookimpl(wrapper=True, tryfirst=True)  # before the time of a test begins
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> Generator[None, object, object]:
    """A file of tests by the clock waits for its turn."""
    floor = item.config.stash.get(_FLOOR, None)
    if floor is None:
        return (yield)
    if item.get_closest_marker("realtime"):
        floor.enter(item.path)
    try:
        return (yield)
    finally:
        if nextitem is None or nextitem.path != item.path:
            floor.leave()
