"""This bench's own entry: trace the open part, carry what was found, and run the observer on through each window.

The observer with the effects found goes over the open part; what it has come to know of the device is what each window
begins with, its motion and rate unknown.  It is corrected by the 200 samples that are seen, and over the 200 that are
asked for it predicts.
"""

import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.challenge.task import ASKED, SEEN, Floats, Record, answer, opened
from estimator.observer import Observer
from estimator.settings import Gain
from hil.bench import Bench, load_bench
from hil.comparing.methods import effects_of
from hil.errors import InputError
from hil.inputs.declared import device_of, observer_settings_of
from hil.library.given import write_capture
from hil.tracing.request import request_of
from hil.tracing.trace import trace

_UNMEASURED = 1e12  # times the variance of a sample that says nothing
_PHASED = ("interference", "base_vibration")
"""Effects with a phase, which a window of unknown time does not know."""


class Found(NamedTuple):
    """The verdict of the trace and its effects."""

    verdict: str
    effects: tuple[str, ...]


def found_in(record: Record, bench: Bench) -> tuple[Found, Bench]:
    """What a trace says of the open part, and the bench with what it explained."""
    with tempfile.TemporaryDirectory() as place:
        capture = Path(place) / "open.arrow"
        write_capture(
            {
                "t_s": np.arange(len(record.sense)) / record.rate_Hz,
                "vx_V": record.sense[:, 0], "vy_V": record.sense[:, 1],
                "ux_mps2": record.drive[:, 0], "uy_mps2": record.drive[:, 1],
            },
            capture,
        )  # fmt: skip
        try:
            said = trace(request_of(capture, bench, {"report": False}), Path(place), progress=lambda _: None).diagnosis
        except InputError as refusal:
            return Found(f"refused: {refusal}", ()), bench
    effects = effects_of(said)
    return Found(said.verdict, tuple(effects)), bench.with_(effects=effects) if effects else bench


def continued(record: Record, bench: Bench) -> Floats:
    """The samples asked for (WINDOWS, ASKED, 2), V."""
    device = device_of(bench)
    settings = observer_settings_of(bench)
    learnt = Observer(device, settings)
    learnt.run(record.sense, record.drive, every=len(record.sense))
    constants = learnt.model.names[learnt.states :]
    base = {name: float(learnt.state[learnt.names.index(name)]) for name in constants if name != "rate"}
    effects = {name: dict(values) for name, values in settings.effects.items()}
    for effect, symbol, place in _coefficients(learnt):
        effects[effect][symbol] = float(learnt.state[len(learnt.model.names) + place])
    begin = replace(settings, gain=Gain.EKF, initial=base, effects=effects)
    said = np.zeros((len(record.window_sense), ASKED, 2))
    for window, (sense, drive) in enumerate(zip(record.window_sense, record.window_drive, strict=True)):
        observer = Observer(device, begin)
        own = observer.arrays.p.copy()
        _begin_about(observer, learnt)
        _forget_phases(observer, own)
        observer.run(sense, drive[:SEEN], every=SEEN)
        with observer.noisier(_UNMEASURED):
            innovation = observer.run(np.zeros((ASKED, 2)), drive[SEEN:], every=ASKED).innovation
        said[window] = -innovation
    return said


def _coefficients(observer: Observer) -> Iterator[tuple[str, str, int]]:
    """Effect, symbol and place among all coefficients."""
    place = 0
    for _, effect in observer.effects:
        for coefficient in effect.coefficients:
            yield effect.name, coefficient.name.partition(":")[0], place
            place += 1


def _begin_about(observer: Observer, learnt: Observer) -> None:
    """Give the constants the covariance that `learnt` ended with, none wider than before a record was seen; of the
    rate, which moves, its own.
    """
    constants = slice(observer.states, None)
    wide, found = observer.arrays.p[constants, constants], learnt.arrays.p[constants, constants]
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.fmin(1.0, np.sqrt(np.diagonal(wide) / np.diagonal(found)))
    rate = observer.estimated.index("rate") - observer.states
    own = wide[rate, rate]
    wide[:] = found * np.outer(scale, scale)
    wide[rate, :] = wide[:, rate] = 0.0
    wide[rate, rate] = own
    observer.arrays.c[:] = observer.arrays.p


def _forget_phases(observer: Observer, own: Floats) -> None:
    """Coefficients of a line as uncertain as before the record."""
    first = len(own) - sum(1 for _ in _coefficients(observer))
    for covariance in (observer.arrays.p, observer.arrays.c):
        for effect, _, place in _coefficients(observer):
            if effect.partition(":")[0] in _PHASED:
                row = first + place
                covariance[row, :] = 0.0
                covariance[:, row] = 0.0
                covariance[row, row] = own[row, row]


def entry(folder: Path, answers: Path) -> dict[str, Found]:
    """Answers below `answers`, and what the trace said of each record."""
    told = {}
    for record in opened(folder):
        found, bench = found_in(record, load_bench(folder / f"{record.name}.bench.toml"))
        answer(answers, record.name, continued(record, bench))
        told[record.name] = found
    return told
