"""Every key of a bench file in every verb: it is read where the verb works, or refused, or the page says it is unused.

A key that is read is not yet one that acts; one that is never read cannot.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

import hil.comparing.methods as comparing
import hil.replaying.replay as replaying
import hil.tracing.trace as tracing
from hil.bench import Bench
from hil.bench.by_verb import NOT_OF, Verb, require_usable
from hil.bench.classic import CLASSIC
from hil.bench.section import Section
from hil.bench.template import keys, sections, template, values_of
from hil.errors import InputError
from hil.records.runfolder import RunFolder
from hil.running import run as whole
from hil.running.concluding import Made, conclude
from hil.running.process import worker
from hil.running.request import RunRequest
from hil.tracing.request import request_of
from tests.running import gyro
from tests.running.test_drive_units import drive_in

LEAVES = {
    (model, name): f"{path}.{name}"
    for path, model in sections(Bench)
    if not path.startswith("effects")
    for name, _ in keys(model)
}
OUTSIDE = {
    "link.url": "where no --link is given",
    "loop.name": "of the folder, by the caller",
    "loop.bench": "of a list of runs",
    "limits.overtime": "by the process that watches the loop",
    "observer.initial_sd.drive_gain": "where [device.drive] gain_known is false, of a single axis",
    **{key: "of a board with trim electrodes" for key in LEAVES.values() if key.startswith("trim.")},
    **{key: "of a commercial gyro beside the run" for key in LEAVES.values() if key.startswith("reference.")},
    **{
        f"device.sense.interface.{key}": "of another kind of interface"
        for key in ("distortion_per_m2", "temperature_per_K", "corner_Hz", "decay_per_m")
    },
}
"""Read elsewhere than in what runs below."""


class Reading:
    """Which keys were read; `paused` where a bench is checked or written as a whole."""

    def __init__(self) -> None:
        self.keys: set[str] = set()
        self.on = False

    def paused(self, function: Callable[..., Any]) -> Callable[..., Any]:
        def quietly(*args: Any, **kwargs: Any) -> Any:
            before, self.on = self.on, False
            try:
                return function(*args, **kwargs)
            finally:
                self.on = before

        return quietly

    @contextmanager
    def during(self) -> Iterator[None]:
        self.keys, self.on = set(), True
        try:
            yield
        finally:
            self.on = False


class Told(dict[str, Any]):
    """The tables of a run folder's bench file, which notes what is asked of it."""

    def __init__(self, table: dict[str, Any], reading: Reading, path: str = "") -> None:
        below = {k: Told(v, reading, f"{path}{k}.") if isinstance(v, dict) else v for k, v in table.items()}
        super().__init__(below)
        self._reading, self._path = reading, path

    def _note(self, key: str) -> None:
        if self._reading.on:
            self._reading.keys.add(self._path + key)

    def __getitem__(self, key: str) -> Any:
        self._note(key)
        return super().__getitem__(key)

    def get(self, key: str, default: Any = None) -> Any:
        self._note(key)
        return super().get(key, default)


@pytest.fixture
def reading(monkeypatch: pytest.MonkeyPatch) -> Reading:
    found, plain = Reading(), Section.__getattribute__

    def noted(self: Section, name: str) -> Any:
        if found.on and (place := LEAVES.get((type(self), name))) is not None:
            found.keys.add(place)
        return plain(self, name)

    monkeypatch.setattr(Section, "__getattribute__", noted)
    for way in ("model_validate", "model_validate_json"):  # what is checked as a whole is read as a whole
        monkeypatch.setattr(Bench, way, found.paused(getattr(Bench, way)))
    for module in (replaying, tracing, comparing):
        monkeypatch.setattr(module, "new_folder", found.paused(whole.new_folder))
    tables = RunFolder.__dict__["bench"].func
    monkeypatch.setattr(RunFolder, "bench", property(lambda folder: Told(tables(folder), found)))
    return found


def declared(mode: str) -> Bench:
    """S-slow, 1.6 s, with a drive in volts, so that what a volt does is asked for, and a gap too wide to matter."""
    gain = {"mode": "gain", "block": 20, "estimate_every": 20} if mode == "gain" else {}
    loop = {"duration_s": 1.6, "settle_s": 0.5, "clock": "lockstep", "seed": 7} | gain
    law = {"controller": {"mode": mode}} if mode in CLASSIC else {}
    wide = {"kind": "gap_closing", "gap_m": (1.0,), "constant_u": 0.01}
    device = {"drive": drive_in("V", 1e-3, 10.0), "sense": {"interface": wide}}
    return gyro.bench(1.6, loop=loop, device=device, **law)


def ran(mode: str, scenario: Path, folder: Path, reading: Reading) -> Path:
    """A run in this process, as the worker and what follows it do it; its capture."""
    folder.mkdir()
    own = declared(mode)
    request = RunRequest(own, f"inproc:{scenario}", {"truth": f"{folder}.arrow"})
    (folder / "bench.toml").write_text(template(values_of(own), "For a test."), encoding="utf-8")
    with reading.during():
        require_usable(own, "run")
        outcome = worker.work(worker.Order(request, str(folder)), worker.untold, own_process=False)
        conclude(Made(folder, own, outcome, request), progress=lambda _: None)
    return folder / "capture.arrow"


def unused(reading: Reading) -> set[str]:
    return set(LEAVES.values()) - reading.keys - set(OUTSIDE)


@pytest.mark.long
def test_every_key_is_read_or_said_to_be_of_no_use(tmp_path: Path, reading: Reading) -> None:
    scenario = gyro.scenario(tmp_path / "board.toml")
    captures, left = {}, set(LEAVES.values())
    for mode in ("force", "gain", "force_to_rebalance"):
        captures[mode] = ran(mode, scenario, tmp_path / mode, reading)
        left &= unused(reading)
    record, own = captures["force"], declared("force")
    found: dict[Verb, set[str]] = {"run": left}
    verbs: dict[Verb, Callable[[], Any]] = {
        "replay": lambda: replaying.replay(record, own, tmp_path / "replayed", progress=lambda _: None),
        "trace": lambda: tracing.trace(
            request_of(record, own, {"report": False}), tmp_path / "traced", progress=lambda _: None
        ),
        "compare": lambda: comparing.compare(
            record, own, tmp_path / "compared", truth=tmp_path / "force.arrow", link=f"inproc:{scenario}",
            progress=lambda _: None,
        ),
    }  # fmt: skip
    for verb, act in verbs.items():
        with reading.during():
            act()
        found[verb] = unused(reading)
    wrong = {}
    for verb, keys_unused in found.items():
        listed = set(NOT_OF[verb]) - set(OUTSIDE)
        wrong |= {(verb, key): "neither read nor listed" for key in keys_unused - listed}
        wrong |= {(verb, key): "listed, but read" for key in listed - keys_unused}
    assert wrong == {}


def test_the_page_lists_what_there_is() -> None:
    known = set(LEAVES.values())
    for verb, listed in NOT_OF.items():
        assert set(listed) <= known, verb


@pytest.mark.parametrize("verb", ["run", "trace", "compare"])
@pytest.mark.parametrize("backend", ["filterpy", "numpy"])
def test_a_backend_is_refused_by_all_but_replay(verb: Verb, backend: str) -> None:
    own = declared("force").with_(observer={"backend": backend})
    with pytest.raises(InputError, match=rf'"{backend}" is for hil replay alone, hil {verb} has "c"') as told:
        require_usable(own, verb)
    assert f"--backend {backend}" in str(told.value)
    require_usable(own, "replay")


@pytest.mark.parametrize("verb", ["run", "replay"])
def test_a_stationary_gain_without_offset_states_refuses_offsets(verb: Verb) -> None:
    own = declared("force").with_(observer={"variant": "gyro", "gain": "stationary"})
    assert own.offset_sd_V > 0.0
    with pytest.raises(InputError, match='use variant = "full", which estimates them'):
        require_usable(own, verb)
    require_usable(own, "compare")  # as prior art
    for other in ({"variant": "full"}, {"gain": "fading"}, {"initial_sd": {"offset_V": 0.0}}):
        require_usable(own.with_(observer=other), verb)


@pytest.mark.parametrize(("device", "key"), [({"drive": {"hold": "foh"}}, "hold"), ({"sense": {"unit": "px"}}, "unit")])
def test_what_is_of_imported_records_is_refused_of_a_board(device: dict[str, Any], key: str) -> None:
    with pytest.raises(InputError, match=rf"{key}: .* is of imported records"):
        require_usable(gyro.bench(device=device), "run")


def test_the_verbs_refuse_before_they_begin(tmp_path: Path) -> None:
    own = declared("force").with_(observer={"backend": "filterpy"})
    capture = tmp_path / "none.arrow"
    acts: list[Callable[[], Any]] = [
        lambda: whole.run(RunRequest(own, "inproc:none"), tmp_path / "runs", progress=lambda _: None),
        lambda: tracing.trace(request_of(capture, own, {}), tmp_path / "runs", progress=lambda _: None),
        lambda: comparing.compare(capture, own, tmp_path / "runs", progress=lambda _: None),
    ]
    for act in acts:
        with pytest.raises(InputError, match="hil replay alone"):
            act()
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize(
    ("loop", "rows", "most"),
    [
        ({"estimate_every": 30000}, "0 rows", 5000),
        ({"estimate_every": 12000}, "0 rows", 5000),
        ({"estimate_every": 6000}, "1 row", 5000),
        ({"estimate_every": 9000, "settle_s": 0.0}, None, None),
        ({"estimate_every": 11000, "settle_s": 0.0}, "1 row", 10000),
    ],
)
def test_a_run_that_would_score_too_few_rows_is_refused(loop: dict[str, Any], rows: str | None, most: int) -> None:
    """Of 20 000 samples, 8000 of which settle; the value that the refusal gives is enough, and no larger one is."""
    long = gyro.bench(5.0, loop={"settle_s": 2.0} | loop)
    require_usable(long, "replay")  # a record has a length of its own
    if rows is None:
        require_usable(long, "run")
        return
    with pytest.raises(InputError, match=rf"\[loop\] estimate_every: .* leaves {rows} .*give at most {most}$"):
        require_usable(long, "run")
    require_usable(long.with_(loop={"estimate_every": most}), "run")
    for every in (most + 1, most + 500):
        with pytest.raises(InputError, match="estimate_every"):
            require_usable(long.with_(loop={"estimate_every": every}), "run")
