"""The figures that a run folder's records give by themselves, without any truth."""

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from hil.records.answers import count_answers
from hil.records.capture import TIME_LOCKSTEP, Capture, RowFlag
from hil.records.clock import ClockRecord
from hil.records.estimates import Estimates
from hil.records.innovation import Innovation
from hil.records.result import Answers, BoardClock, ClockRelation, Ledger, Parameter, Percentiles, Result
from hil.records.runfolder import RunFolder
from hil.records.timing import Timing
from hil.records.truth import Truth
from hil.records.units import symbol_of

SD_95 = 1.959964
"""Half width of a 95 % interval in standard deviations of a normal variable."""

_ONE_CLOCK = "in lockstep no clock runs: there is nothing to relate"
_NOT_ASKED = "nobody asked the board for its time"
_MOVING = ("x_m", "vx_mps", "y_m", "vy_mps", "rate_rad_s")
_PER_MASS = {"1/s²": "N/m", "1/s": "N·s/m"}


def summarise(folder: RunFolder, counters: Mapping[str, int] | None = None) -> Result:
    """Figures of a run from its files: counts, parameters at the end, innovation, turnaround.

    Whatever file is missing leaves its figures null. An existing result.json is not looked at. `counters` are the
    loop's and the board's own.
    """
    capture, estimates, innovation, timing = (
        folder.capture,
        folder.estimates,
        folder.innovation,
        folder.timing,
    )
    counted = answers(capture, timing, counters or {})
    return Result(
        run=folder.path.resolve().name,
        seconds=_seconds(capture, estimates),
        samples=0 if capture is None else len(capture),
        lost=0 if capture is None else lost_samples(capture),
        late=0 if counted is None else counted.late,
        answers=counted,
        parameters={} if estimates is None else parameters(estimates, mass_kg=reporting_mass_kg(folder)),
        innovation_rms=None if innovation is None else innovation_rms(innovation, folder.settle_s),
        noise_floor=None if innovation is None else predicted_rms(innovation, folder.settle_s),
        turnaround_us=None if timing is None else percentiles(timing.turnaround_us),
        ledger_us=None if timing is None else ledger(timing, capture, folder.clock),
        complete=capture is not None and capture.complete,
    )


def lost_samples(capture: Capture) -> int:
    """Samples missing between the first and the last row."""
    return int(capture.tick[-1] - capture.tick[0]) + 1 - len(capture) if len(capture) else 0


def answers(capture: Capture | None, timing: Timing | None, counters: Mapping[str, int]) -> Answers | None:
    """What became of each sample; None where no board was answered."""
    if capture is None or timing is None or "identity" not in capture.header:
        return None
    return count_answers(
        [(capture.tick, capture.flags)],
        timing,
        capture.latency_ticks,
        stopped=counters.get("stopped", 0),
        board_late=counters.get("board_late"),
    )


def parameters(
    estimates: Estimates, *, mass_kg: float | None = None, truth: Truth | None = None
) -> dict[str, Parameter]:
    """Constants and offsets at the last estimate, with value ± 1.96 standard deviations.

    An estimate that diverged (not finite) is left out. Per unit mass, or with `mass_kg` in N/m and N·s/m.
    The truth of an offset is its value at the last common instant, since offsets may drift.
    """
    if not len(estimates):
        return {}
    table: dict[str, Parameter] = {}
    for name in estimates.states:
        if name in _MOVING:
            continue
        unit = estimates.unit(name)
        factor = mass_kg if mass_kg is not None and unit in _PER_MASS else 1.0
        value, spread = float(estimates[name][-1]), SD_95 * float(estimates.sd(name)[-1])
        if not np.isfinite([value, spread]).all():
            continue
        true = None if truth is None else _true_value(name, estimates, truth)
        table[symbol_of(name)] = Parameter(
            value=factor * value,
            ci95=(factor * (value - spread), factor * (value + spread)),
            unit=unit if factor is not mass_kg else _PER_MASS[unit],
            truth=None if true is None else factor * true,
        )
    return table


def innovation_rms(innovation: Innovation, settle_s: float) -> float | None:
    """Root mean square in volts over all axes from `settle_s` on; None when there is nothing after it."""
    scored = innovation.nu_V[innovation.t_s >= settle_s]
    return rms(scored)


def predicted_rms(innovation: Innovation, settle_s: float) -> float | None:
    """What `innovation_rms` would be for a complete model: the predicted standard deviation, as the median,
    since after a gap in the record the prediction is wide for a few samples and that is no noise floor.
    """
    scored = innovation.sd_V[innovation.t_s >= settle_s]
    return float(np.sqrt(np.mean(np.median(scored, axis=0) ** 2))) if scored.size else None


def rms(values: npt.NDArray[np.float64]) -> float | None:
    """Root mean square of all elements; None when there are none, or one is not finite."""
    return float(np.sqrt(np.mean(values**2))) if values.size and np.isfinite(values).all() else None


def percentiles(times_us: npt.NDArray[np.float64]) -> Percentiles | None:
    """p50, p99 and p99.9 of a set of times; None of an empty one."""
    if not times_us.size:
        return None
    p50, p99, p999 = (float(value) for value in np.percentile(times_us, (50.0, 99.0, 99.9)))
    return Percentiles(p50=p50, p99=p99, p999=p999)


def ledger(timing: Timing, capture: Capture | None, clock: ClockRecord | None) -> Ledger | None:
    """Percentiles of each stage of the blocks; None in lockstep, and where nothing tells when answers acted."""
    applied = timing.applied
    if applied is None and capture is not None:
        applied = applied_ticks(timing.tick, capture)
    stages = {} if applied is None else timing.ledger_us(applied, clock)
    if not stages:
        return None
    # A block that was applied before it could have been known on its clock is noise of that clock.
    found = {name: percentiles(np.maximum(elapsed, 0.0)) for name, elapsed in stages.items()}
    return Ledger.model_validate({name: value for name, value in found.items() if value is not None})


def applied_ticks(tick: npt.NDArray[np.int64], capture: Capture) -> npt.NDArray[np.int64]:
    """Force mode: the tick from which the answer to each tick (n,) acted, -1 where it did not in time or nobody knows.

    The row after it tells: it carries the drive held since, and a flag where that was an old one.
    """
    effective = tick + capture.latency_ticks
    told = capture.tick[(capture.flags & RowFlag.LATE_ANSWER_HELD) == 0]
    return np.where(np.isin(effective + 1, told), effective, -1)


def board_clock(folder: RunFolder) -> BoardClock | None:
    """What the times of a recorded run are on; None without a capture that says so."""
    capture, clock = folder.capture, folder.clock
    if capture is None or "time" not in capture.header:
        return None
    base = str(capture.header["time"])
    if clock is None:
        return BoardClock(time_base=base, unknown=_ONE_CLOCK if base == TIME_LOCKSTEP else _NOT_ASKED)
    fit = clock.fit
    if fit is None:
        return BoardClock(time_base=base, unknown=clock.unknown)
    relation = ClockRelation(
        at_host_ns=fit.at_host_ns,
        offset_ns=fit.offset_ns,
        offset_uncertainty_ns=fit.offset_uncertainty_ns,
        skew_ppm=1e6 * fit.skew,
        skew_uncertainty_ppm=1e6 * fit.skew_ci,
        skew_bound_ppm=1e6 * fit.skew_bound,
        round_trip_us=1e-3 * fit.round_trip_ns,
        exchanges=fit.exchanges,
        used=fit.used,
    )
    return BoardClock(time_base=base, relation=relation)


def reporting_mass_kg(folder: RunFolder) -> float | None:
    """The mass to multiply by, when the bench file asks for unnormalised parameters; else None."""
    device = folder.bench.get("device", {})
    return float(device["mass_kg"]) if device.get("normalised") is False and "mass_kg" in device else None


def _seconds(capture: Capture | None, estimates: Estimates | None) -> float:
    times = capture.t_s if capture is not None else estimates.t_s if estimates is not None else np.empty(0)
    return float(times[-1] - times[0]) if times.size else 0.0


def _true_value(name: str, estimates: Estimates, truth: Truth) -> float | None:
    if name in truth.constants:
        return truth.constants[name]
    if name not in truth.columns:
        return None
    _, ours = truth.at(estimates.tick)
    return float(truth[name][ours[-1]]) if ours.size else None
