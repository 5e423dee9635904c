"""Each option of a verb reaches every caller: it is declared once, and each makes its own of it."""

import inspect
import tomllib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple, get_args

import pytest
from pydantic import BaseModel

import hil
from hil.bench import Bench
from hil.bench.template import template, values_of
from hil.characterising.options import CharacteriseOptions, LocalCharacteriseOptions
from hil.cli.app import VERBS
from hil.client import Board, Service, connect
from hil.identifying.options import IdentifyOptions, LocalIdentifyOptions
from hil.importing.options import ImportOptions, LocalImportOptions
from hil.options import Keyword, keywords_of
from hil.records.result import Result
from hil.records.runfolder import RunFolder
from hil.replaying.options import ReplayOptions
from hil.running.options import FileOptions, LocalRunOptions, RunOptions
from hil.sensors.options import LocalRecordOptions, RecordOptions
from hil.service.jobs.asked import Asked
from hil.service.routes_board import Start
from hil.sweeping.campaign import Campaign
from hil.sweeping.options import LocalSweepOptions, SweepOptions
from hil.testing.board import BoardUnderTest, RecordUnderTest, SensorUnderTest
from hil.tracing.options import TraceOptions
from tests.forked import hil_says
from tests.running import gyro
from tests.service.serving import serving
from tests.test_pytest_plugin import PLUGIN

pytest_plugins = ["pytester"]

Takes = Callable[[Keyword], bool]


def words(verb: str) -> Takes:
    """An option of the command line."""
    function = next(one for one in VERBS if one.__name__.rstrip("_") == verb)

    def takes(one: Keyword) -> bool:
        option = get_args(inspect.signature(function).parameters[one.name].annotation)[1]
        flags = {flag for names in (option.default, *(option.param_decls or ())) for flag in names.split("/")}
        return f"--{one.called.name.replace('_', '-')}" in flags and option.help == one.help

    return takes


def keyword(function: Callable[..., Any]) -> Takes:
    """A keyword of a function, told in its help."""

    def takes(one: Keyword) -> bool:
        return one.name in inspect.signature(function).parameters and f"{one.name}: {one.help}" in (
            function.__doc__ or ""
        )

    return takes


def field(model: type[BaseModel]) -> Takes:
    """A field of a body or of a table of a file, told in its schema."""
    properties = model.model_json_schema()["properties"]
    return lambda one: properties.get(one.outside, {}).get("description") == one.help


def body(kind: str) -> Takes:
    """Of the service's job of that kind."""
    return field(
        next(one for one in get_args(get_args(Asked)[0]) if kind in get_args(one.model_fields["kind"].annotation))
    )


def table(name: str) -> Takes:
    """Of a campaign file."""
    found = Campaign.model_fields[name].annotation
    assert found is not None
    return field(found)


CALLERS: dict[str, tuple[type, type, dict[str, Takes]]] = {
    "run": (RunOptions, LocalRunOptions, {
        "command line": words("run"), "library": keyword(hil.run), "live library": keyword(hil.open),
        "dry run": keyword(hil.dry_run), "service's board": field(Start), "service's jobs": body("run"),
        "client": keyword(Board.start), "client's run": keyword(Service.run), "campaign": table("run"),
    }),
    "trace": (TraceOptions, TraceOptions, {
        "command line": words("trace"), "library": keyword(hil.trace), "service": body("trace"),
        "client": keyword(Service.trace), "campaign": table("trace"), "board of a test": keyword(BoardUnderTest.trace),
        "record of a test": keyword(RecordUnderTest.trace),
    }),
    "import": (ImportOptions, LocalImportOptions, {
        "command line": words("import"), "library": keyword(hil.import_record), "arrays": keyword(hil.trace),
        "service": body("import"), "client": keyword(Service.import_record),
    }),
    "replay": (ReplayOptions, ReplayOptions, {
        "command line": words("replay"), "library": keyword(hil.replay), "service": body("replay"),
        "client": keyword(Service.replay), "record of a test": keyword(RecordUnderTest.replay),
    }),
    "characterise": (CharacteriseOptions, LocalCharacteriseOptions, {
        "command line": words("characterise"), "library": keyword(hil.characterise), "service": body("characterise"),
        "client": keyword(Service.characterise),
    }),
    "identify": (IdentifyOptions, LocalIdentifyOptions, {
        "command line": words("identify"), "library": keyword(hil.identify), "service": body("identify"),
        "client": keyword(Service.identify),
    }),
    "record": (RecordOptions, LocalRecordOptions, {
        "command line": words("record"), "library": keyword(hil.record), "service": body("record"),
        "client": keyword(Service.record), "sensor of a test": keyword(SensorUnderTest.record),
    }),
    "sweep": (SweepOptions, LocalSweepOptions, {
        "command line": words("sweep"), "library": keyword(hil.sweep), "service": body("sweep"),
        "client": keyword(Service.sweep),
    }),
}  # fmt: skip
HERE = ("command line", "library", "live library", "dry run")
"""Callers that name files of this machine too."""


def cases() -> Iterator[Any]:
    for verb, (everywhere, here, callers) in CALLERS.items():
        for caller, takes in callers.items():
            for one in keywords_of(here if caller in HERE else everywhere):
                yield pytest.param(takes, one, id=f"{verb}: {one.name}: {caller}")


@pytest.mark.parametrize(("takes", "one"), list(cases()))
def test_it_is_there(takes: Takes, one: Keyword) -> None:
    assert takes(one)


def test_no_request_names_a_file() -> None:
    for kind in ("run", "trace", "replay", "record", "import", "sweep", "characterise", "identify"):
        _, here, _ = CALLERS[kind]
        for one in keywords_of(here):
            if one.name in ("truth", "wire_log", "out", "scheduler", "replace", "junit", "calibrate", "baseline"):
                assert not body(kind)(one)
    assert not any(field(Start)(one) for one in keywords_of(FileOptions))


# -- and it acts -------------------------------------------------------------------------------------------------------


class Made(NamedTuple):
    """What a caller's run left: its folder, the truth where it was asked for, the row of a campaign."""

    folder: Path
    truth: Path | None

    @property
    def result(self) -> Result:
        found = RunFolder(self.folder).result
        assert found is not None
        return found

    @property
    def bench(self) -> dict[str, Any]:
        return tomllib.loads((self.folder / "bench.toml").read_text())


GIVEN: RunOptions = {
    "duration_s": 0.75, "clock": "lockstep", "seed": 77, "name": "asked", "note": "of a test", "open_loop": True,
}  # fmt: skip
ACTED: Mapping[str, Callable[[Made], object]] = {
    "duration_s": lambda made: made.result.samples == 300,
    "clock": lambda made: made.result.clock == "lockstep",
    "seed": lambda made: made.bench["loop"]["seed"] == 77,
    "name": lambda made: "asked" in made.folder.name,
    "note": lambda made: made.result.operator_note == "of a test",
    "open_loop": lambda made: made.bench["controller"]["enabled"] is False,
    "truth": lambda made: made.truth is not None and made.truth.stat().st_size > 1000,
    "replace": lambda made: made.truth is not None and b"before" not in made.truth.read_bytes()[:6],
}
FLAGS = [
    "--duration", "0.75", "--clock", "lockstep", "--seed", "77", "--name", "asked", "--note", "of a test",
    "--open-loop",
]  # fmt: skip


class Place(NamedTuple):
    """A bench file of a device at 400 Hz, its board, and where runs go."""

    bench: Path
    scenario: Path
    runs: Path
    truth: Path


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Place]:
    folder = tmp_path_factory.mktemp("callers")

    def made(caller: str) -> Place:
        here = folder / caller.replace(" ", "-")
        here.mkdir()
        declared: Bench = gyro.unhurried_bench(60.0).with_(loop={"settle_s": 0.2})
        (here / "unhurried.bench.toml").write_text(template(values_of(declared), ""))
        scenario = gyro.unhurried_scenario(here / "unhurried.scenario.toml")
        (here / "truth.arrow").write_text("before")
        return Place(here / "unhurried.bench.toml", scenario, here / "runs", here / "truth.arrow")

    return made


def newest(runs: Path) -> Path:
    return max(one.parent for one in runs.glob("*/capture.arrow"))


def on_the_command_line(at: Place, kind: str, *more: str) -> Made:
    options = [*FLAGS, "--truth", str(at.truth), "--replace", "--out", str(at.runs), "--json", *more]
    done = hil_says("run", str(at.bench), "--link", f"{kind}:{at.scenario}", *options)
    assert done.returncode in (0, 1), done.stderr
    return Made(newest(at.runs), at.truth)


def in_the_library(at: Place) -> Made:
    run = hil.run(at.bench, link=f"inproc:{at.scenario}", out=at.runs, truth=at.truth, replace=True, **GIVEN)
    return Made(run.path, at.truth)


def of_the_service(at: Place) -> Made:
    link = f"pty:{at.scenario.name}"
    with serving(at.runs) as there, connect(there.url, there.token()) as client:
        run = client.run(at.bench, link=link, **GIVEN)
    return Made(at.runs / run.id, None)


def by_a_job(at: Place) -> Made:
    asked = {"bench": at.bench.name, "link": f"inproc:{at.scenario.name}", **GIVEN}
    with serving(at.runs) as there, connect(there.url, there.token()) as client:
        return Made(at.runs / client.job("run", **asked)["result"]["run"], None)


def in_a_campaign(at: Place) -> Made:
    campaign = {"name": "asked", "scenario": str(at.scenario), "bench": str(at.bench), "run": dict(GIVEN)}
    swept = hil.sweep(campaign, out=at.runs, workers=1)
    assert swept.table["samples"].to_pylist() == [300]
    from hil.sweeping.again import make_again

    again = make_again(swept._plan, 0, at.runs.parent / "again", at.runs, progress=lambda _: None)
    assert again.same
    return Made(again.folder, again.folder / "truth.arrow")


CALLED: Mapping[str, Callable[[Place], Made]] = {
    "command line": lambda at: on_the_command_line(at, "inproc"),
    "--live": lambda at: on_the_command_line(at, "pty", "--live"),
    "--live in this process": lambda at: on_the_command_line(at, "inproc", "--live"),
    "library": in_the_library,
    "service": of_the_service,
    "job": by_a_job,
    "campaign": in_a_campaign,
}
WITHOUT_FILES = ("service", "job")
RUNS: dict[str, Made] = {}


def acting() -> Iterator[Any]:
    for caller in CALLED:
        for option in ACTED:
            if caller not in WITHOUT_FILES or option not in ("truth", "replace"):
                lighter = caller != "--live in this process"  # whose way is that of the two beside it
                marks = () if lighter else (pytest.mark.long,)
                yield pytest.param(caller, option, id=f"{caller}: {option}", marks=marks)


@pytest.mark.slow
@pytest.mark.parametrize(("caller", "option"), list(acting()))
def test_it_acts(place: Callable[[str], Place], caller: str, option: str) -> None:
    if caller not in RUNS:
        RUNS[caller] = CALLED[caller](place(caller))
    assert ACTED[option](RUNS[caller])


@pytest.mark.slow
def test_each_acts_in_a_test_of_a_board(place: Callable[[str], Place], pytester: pytest.Pytester) -> None:
    at = place("pytest")
    pytester.makepyfile(
        f"""
        import tomllib

        def test_runs(board):
            run = board.run(truth=True, **{GIVEN!r})
            declared = tomllib.loads((run.folder.path / "bench.toml").read_text())
            assert run.result.samples == 300
            assert run.result.clock == "lockstep"
            assert declared["loop"]["seed"] == 77
            assert "asked" in run.folder.path.name
            assert run.result.operator_note == "of a test"
            assert declared["controller"]["enabled"] is False
            assert run.result.score is not None
        """
    )
    options = ("--hil-bench", str(at.bench), "--hil-link", f"inproc:{at.scenario}")
    pytester.runpytest_subprocess(*PLUGIN, *options).assert_outcomes(passed=1)


@pytest.mark.slow
@pytest.mark.parametrize("live", [False, True])
def test_the_wire_log_reaches_the_loop(place: Callable[[str], Place], *, live: bool) -> None:
    """What it is refused with beside a link without frames comes from where the loop would begin to write it."""
    at = place(f"wire log {live}")
    options = ["--wire-log", str(at.runs.parent / "bus.log"), "--out", str(at.runs), *(["--live"] if live else [])]
    done = hil_says("run", str(at.bench), "--link", f"pty:{at.scenario}", *options)
    logs = "".join(log.read_text() for log in at.runs.glob(".service/board.log"))
    assert done.returncode == 2, f"{done.stderr}\n{logs}"
    assert "has no CAN frames to log; use a link can:…" in done.stderr, f"{done.stderr}\n{logs}"


def test_the_wire_log_reaches_the_loop_from_the_library(place: Callable[[str], Place]) -> None:
    at = place("wire log of the library")
    with pytest.raises(hil.WireError, match="has no CAN frames to log"):
        hil.run(at.bench, link=f"inproc:{at.scenario}", out=at.runs, wire_log=at.runs / "bus.log", clock="lockstep")


# -- of a trace, by what it is refused with: no search is waited for ---------------------------------------------------

REFUSED: Mapping[str, tuple[TraceOptions, list[str], str]] = {
    "covariate": ({"covariate": "load_kg"}, ["--covariate", "load_kg"], "belong to several records"),
    "hold_out": ({"hold_out": ["a"]}, ["--hold-out", "a"], "belong to several records"),
    "fraction": ({"fraction": 0.001}, ["--fraction", "0.001"], "the part to be fitted has"),
}  # fmt: skip


@pytest.fixture(scope="module")
def recorded(place: Callable[[str], Place]) -> Place:
    """A run of a second and a half, to be traced."""
    at = place("recorded")
    hil.run(at.bench, link=f"inproc:{at.scenario}", out=at.runs, clock="lockstep", duration_s=1.5)
    return at


@pytest.mark.slow
@pytest.mark.parametrize("option", REFUSED)
def test_an_option_of_a_trace_reaches_it_from_terminal_and_library(recorded: Place, option: str) -> None:
    given, flags, says = REFUSED[option]
    done = hil_says("trace", str(newest(recorded.runs)), "--out", str(recorded.runs), *flags)
    assert done.returncode == 2
    assert says in done.stderr
    with pytest.raises(hil.InputError, match=says):
        hil.trace(newest(recorded.runs), out=recorded.runs, **given)
    with pytest.raises(hil.InputError, match=says):
        RecordUnderTest(newest(recorded.runs), None, recorded.runs.parent).trace(**given)


@pytest.mark.slow
def test_an_option_of_a_trace_reaches_it_from_a_request(recorded: Place) -> None:
    with serving(recorded.runs) as there, connect(there.url, there.token()) as client:
        for given, _, says in REFUSED.values():
            with pytest.raises(hil.InputError, match=says):
                client.trace(newest(recorded.runs).name, **given)
