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

from collections.abc import Generator, Iterator
from contextlib import contextmanager
from itertools import takewhile
from os.path import relpath
from pathlib import Path
from shlex import quote
from traceback import walk_tb
from typing import TYPE_CHECKING, TypeVar

import pytest

if TYPE_CHECKING:
    from hil.bench import Bench
    from hil.testing.board import BoardUnderTest, RecordUnderTest, SensorUnderTest

pytest.register_assert_rewrite("hil.testing.board_rules")  # or an assertion there says nothing

_FAULT = pytest.StashKey[bool]()
_USED = pytest.StashKey[list["BoardUnderTest | RecordUnderTest | SensorUnderTest"]]()
_BOARD = "hil.testing.board"
_Used = TypeVar("_Used", "BoardUnderTest", "RecordUnderTest", "SensorUnderTest")


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

    with _refused():
        return load_bench(_bench_path(request.config))


@pytest.fixture
def board(request: pytest.FixtureRequest, bench: "Bench", tmp_path: Path) -> Iterator["BoardUnderTest"]:
    """The board at `--hil-link`, connected when first used and SAFE afterwards. Skips what it cannot do."""
    from hil.boards.emulation import is_emulated, located
    from hil.errors import InputError
    from hil.testing.board import BoardUnderTest, CannotDo

    config = request.config
    with _refused():
        path = _bench_path(config)
        if not (given := _setting(config, "link") or bench.link.url):
            raise InputError(f"{path}: [link] url: missing; give it there or as --hil-link")
        link = located(given, beside=path)
    if request.node.get_closest_marker("hil_emulated") and not is_emulated(link):
        pytest.skip(f"{link} is not emulated here")
    may_arm = is_emulated(link) or bool(config.getoption("--hil-arm"))
    under_test = BoardUnderTest(bench, link, tmp_path / "runs", may_arm=may_arm, clock=_setting(config, "clock"))
    _used(request, under_test)
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
    from hil.testing.board import SensorUnderTest

    with _refused():
        link = _given(request.config, "sensor", "stim300:/dev/ttyUSB0")
        return _used(request, SensorUnderTest(link, tmp_path / "runs"))


@pytest.fixture
def record(request: pytest.FixtureRequest, tmp_path: Path) -> "RecordUnderTest":
    """The record at `--hil-record`, imported where it is no capture, with the bench of `--hil-bench` or its own."""
    from hil.testing.board import RecordUnderTest

    config = request.config
    with _refused():
        place = Path(_given(config, "record", "FILE"))
        bench = _bench_path(config) if _setting(config, "bench") else None
        return _used(request, RecordUnderTest(place, bench, tmp_path, mapping=_setting(config, "map")))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item: pytest.Item) -> Iterator[None]:
    """As the call: a fixture of the user may talk to the board."""
    return (yield from _ended(item))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Iterator[None]:
    """A test that finds out on its way that this board cannot do what it needs is skipped; what a user can mend is
    one line."""
    return (yield from _ended(item))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """A test that fails says where what it made is kept: in the terminal, and in JUnit as properties."""
    report = yield
    made = [folder for used in item.stash.get(_USED, []) for folder in used.made]
    if report.failed and made:
        said = [(name, str(path)) for folder in made for name, path in _named(folder)]
        report.sections.append(("hil", "\n".join(f"{name}: {path}" for name, path in said)))
        item.user_properties += [(f"hil {name}", path) for name, path in said]
    return report


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    """A fault of the bench is no verdict on a board: the exit code is 3, as of `hil`."""
    if session.config.stash.get(_FAULT, False):
        from hil.errors.ending import ExitCode

        session.exitstatus = int(ExitCode.FAULT)


def _ended(item: pytest.Item) -> Iterator[None]:
    try:
        return (yield)
    except Exception as error:
        frames = [
            (f.f_globals.get("__name__", ""), f.f_code.co_filename, line) for f, line in walk_tb(error.__traceback__)
        ]
        if isinstance(error, AssertionError) or _BOARD not in [module for module, _, _ in frames]:
            raise
        if type(error).__name__ == "CannotDo":
            pytest.skip(str(error))
        from hil.errors import told_to_user

        if (told := told_to_user(error)) is None:
            item.session.config.stash[_FAULT] = True
            raise
        outside = takewhile(lambda frame: not frame[0].startswith("hil.") or frame[0] == __name__, frames)
        *_, (_, file, line) = outside
        place = f"{relpath(file, item.config.rootpath)}:{line}"
        raise pytest.fail.Exception(f"{place}: {told}", pytrace=False) from None


@contextmanager
def _refused() -> Iterator[None]:
    """What a user gave and can mend is one line, in words of this plug-in's options."""
    from hil.errors import InputError
    from hil.wire.errors import WireError

    try:
        yield
    except (InputError, WireError) as error:
        from hil.library.keywords import OPTION

        own = ("map", "bench")
        told = error.typed if isinstance(error, InputError) else str(error)
        told = OPTION.sub(lambda found: f"--hil-{found['name']}" if found["name"] in own else found[0], told)
        raise pytest.fail.Exception(told, pytrace=False) from None


def _used(request: pytest.FixtureRequest, under_test: _Used) -> _Used:
    """`under_test`, whose `made` is said where the test fails."""
    request.node.stash.setdefault(_USED, []).append(under_test)
    return under_test


def _named(folder: Path) -> Iterator[tuple[str, Path | str]]:
    yield "folder", folder
    if (page := folder / "report.html").exists():
        yield "report", page
    yield "shown by", f"hil show {quote(str(folder))}"


def _bench_path(config: pytest.Config) -> Path:
    from hil.bench.examples import find
    from hil.errors import InputError

    name = _setting(config, "bench")
    if not name:
        link = _setting(config, "link") or "LINK"
        writes = f"hil init --from-board --link {link} -o my.bench.toml writes one"
        raise InputError(f"no bench file: give --hil-bench FILE, or hil_bench in pytest's ini file; {writes}")
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
