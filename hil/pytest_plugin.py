"""A pytest plugin for acceptance tests of a board: the same test on an emulated board, a virtual bus, or hardware.

    pytest --hil-bench my.bench.toml --hil-link serial:/dev/ttyACM0 --hil-arm
    pytest --hil-sensor stim300:/dev/ttyUSB0
    pytest --hil-bench my.bench.toml --hil-record ride.csv --hil-map my.map.toml

Fixtures: `bench`, the bench file; `board`, a `hil.testing.board.BoardUnderTest` of that link; `sensor`, a
`hil.testing.board.SensorUnderTest`; `record`, a `hil.testing.board.RecordUnderTest`. Markers:
`hil_clock(name)`, the test needs a board that keeps that clock; `hil_emulated`, it needs an emulated board (its truth,
say).

pytest loads this module in every project it runs in once the package is installed, so nothing is imported here that a
session without these fixtures would have to pay for.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from hil.bench import Bench
    from hil.testing.board import BoardUnderTest, RecordUnderTest, SensorUnderTest

_FAULT = pytest.StashKey[bool]()


def pytest_addoption(parser: pytest.Parser) -> None:
    """Options, and keys of pytest's ini file of the same names."""
    group = parser.getgroup("hil", "acceptance tests of a gyro board")
    for name, what in (
        ("bench", "bench file of the board, or the name of an example"),
        ("link", "link to the board (serial:…, can:…, udp:…, pty:SCENARIO, inproc:SCENARIO); default: [link] url"),
        ("clock", "lockstep, paced or real; default: the bench file's, or what the board keeps"),
        ("sensor", "link to a sensor that cannot be driven (stim300:/dev/ttyUSB0)"),
        ("record", "run folder, capture, or file that hil import reads"),
        ("map", "map of that file, or the name of an example"),
    ):
        group.addoption(f"--hil-{name}", help=what)
        parser.addini(f"hil_{name}", what)
    group.addoption(
        "--hil-arm", action="store_true", help="consent to arming a board that is not emulated; else such tests skip"
    )


def pytest_configure(config: pytest.Config) -> None:
    """Markers."""
    config.addinivalue_line("markers", "hil_clock(name): needs a board that keeps this clock (lockstep, paced, real)")
    config.addinivalue_line("markers", "hil_emulated: needs a board that is emulated here")


@pytest.fixture(scope="session")
def bench(request: pytest.FixtureRequest) -> "Bench":
    """The bench file of `--hil-bench`."""
    from hil.bench import load_bench
    from hil.errors import InputError

    try:
        return load_bench(_bench_path(request.config))
    except InputError as error:
        pytest.fail(str(error), pytrace=False)


@pytest.fixture
def board(request: pytest.FixtureRequest, bench: "Bench", tmp_path: Path) -> Iterator["BoardUnderTest"]:
    """The board at `--hil-link`, connected when first used and SAFE afterwards. Skips what it cannot do."""
    from hil.boards.emulation import is_emulated, located
    from hil.errors import InputError
    from hil.testing.board import BoardUnderTest, CannotDo
    from hil.wire.errors import LinkError

    config = request.config
    try:
        path = _bench_path(config)
        if not (given := _setting(config, "link") or bench.link.url):
            raise InputError(f"{path}: [link] url: missing; give it there or as --hil-link")
        link = located(given, beside=path)
    except (InputError, LinkError) as error:
        pytest.fail(str(error), pytrace=False)
    if request.node.get_closest_marker("hil_emulated") and not is_emulated(link):
        pytest.skip(f"{link} is not emulated here")
    may_arm = is_emulated(link) or bool(config.getoption("--hil-arm"))
    under_test = BoardUnderTest(bench, link, tmp_path / "runs", may_arm=may_arm, clock=_setting(config, "clock"))
    try:
        if clock := request.node.get_closest_marker("hil_clock"):
            under_test.require_clock(*clock.args)
        yield under_test
    except CannotDo as reason:
        pytest.skip(str(reason))
    finally:
        under_test.close()


@pytest.fixture
def sensor(request: pytest.FixtureRequest, tmp_path: Path) -> "SensorUnderTest":
    """The sensor at `--hil-sensor`; nothing is opened before it is recorded."""
    from hil.errors import InputError
    from hil.testing.board import SensorUnderTest

    try:
        return SensorUnderTest(_given(request.config, "sensor", "stim300:/dev/ttyUSB0"), tmp_path / "runs")
    except InputError as error:
        pytest.fail(str(error), pytrace=False)


@pytest.fixture
def record(request: pytest.FixtureRequest, tmp_path: Path) -> "RecordUnderTest":
    """The record at `--hil-record`, imported where it is no capture, with the bench of `--hil-bench` or its own."""
    from hil.errors import InputError
    from hil.testing.board import RecordUnderTest

    config = request.config
    try:
        place = Path(_given(config, "record", "FILE"))
        bench = _bench_path(config) if _setting(config, "bench") else None
        return RecordUnderTest(place, bench, tmp_path, mapping=_setting(config, "map"))
    except InputError as error:
        pytest.fail(str(error), pytrace=False)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Iterator[None]:
    """A test that finds out on its way that this board cannot do what it needs is skipped."""
    try:
        return (yield)
    except Exception as error:
        if type(error).__name__ == "CannotDo" and type(error).__module__ == "hil.testing.board":
            pytest.skip(str(error))
        if _is_ours(error):
            item.session.config.stash[_FAULT] = True
        raise


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    """A fault of the bench is no verdict on a board: the exit code is 3, as of `hil`."""
    if session.config.stash.get(_FAULT, False):
        from hil.errors.ending import ExitCode

        session.exitstatus = int(ExitCode.FAULT)


def _is_ours(error: Exception) -> bool:
    """Whether it was raised by the bench's own code, and is nothing that a user can mend."""
    from traceback import walk_tb

    modules = {frame.f_globals.get("__name__") for frame, _ in walk_tb(error.__traceback__)}
    if isinstance(error, AssertionError) or "hil.testing.board" not in modules:
        return False
    from hil.errors import told_to_user

    return told_to_user(error) is None


def _bench_path(config: pytest.Config) -> Path:
    from hil.bench.examples import find
    from hil.errors import InputError

    name = _setting(config, "bench")
    if not name:
        raise InputError("no bench file: give --hil-bench FILE, or hil_bench in pytest's ini file")
    return find("bench", name, beside=config.inipath)


def _given(config: pytest.Config, name: str, example: str) -> str:
    from hil.errors import InputError

    if (given := _setting(config, name)) is None:
        raise InputError(f"no {name}: give --hil-{name} {example}, or hil_{name} in pytest's ini file")
    return given


def _setting(config: pytest.Config, name: str) -> str | None:
    given = config.getoption(f"--hil-{name}")
    value = given if given is not None else config.getini(f"hil_{name}")
    return str(value) if value else None
