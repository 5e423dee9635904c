"""The figures of a run and of a trace by name: what the catalogue keeps, and two of them are compared by."""

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

from hil.records.result import Percentiles, Result

if TYPE_CHECKING:
    from hil.records.diagnosis import Coefficient, Diagnosis


class Known(NamedTuple):
    """A figure: name, value, unit, half width of its 95 % interval where it has one, and what is better: `less`,
    `more`, `one` (the nearer to one), None where no value is."""

    name: str
    value: float
    unit: str
    u: float | None = None
    better: str | None = None


HEADLINES = (
    "angle_rad", "angle_u_rad", "angle_expanded_rad", "angle_error_rms_rad", "rate_error_rms_rad_s", "residual_ratio",
    "answered_fraction", "turnaround_p99_us", "ratio_before", "ratio_after", "angle_moved_rad",
)  # fmt: skip
"""Those that every row of a list has, where the run has them."""


def of_run(result: Result) -> list[Known]:
    """Figures of a run; what was not measured is left out."""
    return _sound(_of_run(result))


def of_trace(found: "Diagnosis") -> list[Known]:
    return _sound(_of_trace(found))


_Told = tuple[str, float | None, str, float | None, str | None]


def _sound(told: Iterator[_Told]) -> list[Known]:
    """Those that are numbers, each name and unit once."""
    found: dict[tuple[str, str], Known] = {}
    for name, value, unit, u, better in told:
        if value is not None and math.isfinite(value):
            half = u if u is not None and math.isfinite(u) else None
            found.setdefault((name, unit), Known(name, float(value), unit, half, better))
    return list(found.values())


def _of_run(result: Result) -> Iterator[_Told]:
    if (angle := result.angle) is not None:
        yield "angle_rad", angle.rad, "rad", result.angle_expanded_rad, None
        yield "control_imperfection_rms_rad", angle.control_imperfection_rms_rad, "rad", None, "less"
    yield "angle_u_rad", result.angle_u_rad, "rad", None, "less"
    yield "angle_expanded_rad", result.angle_expanded_rad, "rad", None, "less"
    yield "angle_error_rms_rad", result.angle_error_rms_rad, "rad", None, "less"
    yield "rate_error_rms_rad_s", result.rate_error_rms_rad_s, "rad/s", None, "less"
    if (score := result.score) is not None:
        yield "turns", score.turns, "", None, None
        yield "angle_per_rotation", score.angle_per_rotation, "", None, "one"
        yield "angle_error_max_rad", score.angle_error_max_rad, "rad", None, "less"
        yield "rate_error_max_rad_s", score.rate_error_max_rad_s, "rad/s", None, "less"
        if score.nees is not None:
            yield "nees", score.nees.mean, "", None, "one"
    yield "innovation_rms", result.innovation_rms, "V", None, "less"
    yield "noise_floor", result.noise_floor, "V", None, None
    yield "residual_ratio", result.residual_ratio, "", None, "less"
    for name, parameter in result.parameters.items():
        yield name, parameter.value, parameter.unit, parameter.half, None
    yield "seconds", result.seconds, "s", None, None
    yield "samples", result.samples, "", None, None
    yield "lost", result.lost, "", None, "less"
    yield "late", result.late, "", None, "less"
    if (answers := result.answers) is not None and answers.ticks:
        yield "answered_fraction", answers.in_time / answers.ticks, "", None, "more"
        yield "slow", answers.slow, "", None, "less"
    yield from _times("turnaround", result.turnaround_us)
    yield from _times("bare_turnaround", result.bare_turnaround_us)
    if (ledger := result.ledger_us) is not None:
        yield from _times("wire", ledger.wire)
        yield from _times("total", ledger.total)
    if (load := result.load) is not None:
        for part in ("loop", "recorder", "waited", "stolen", "pressed"):
            yield f"load_{part}", getattr(load, part), "", None, "less"
    if (clock := result.board_clock) is not None and (relation := clock.relation) is not None:
        yield "clock_skew_ppm", relation.skew_ppm, "ppm", relation.skew_uncertainty_ppm, None
    if (scan := result.scan) is not None:
        yield "scan_ratio", scan.ratio, "", None, "less"
        yield "lacking", len(scan.lacks), "", None, "less"
    for name in ("stops", "frames_lost", "frames_damaged"):
        yield name, result.counters.get(name), "", None, "less"
    if (sensor := result.sensor) is not None:
        for axis, channel in sensor.channels.items():
            yield f"mean_{axis}_rad_s", channel.mean_rad_s, "rad/s", None, None
            yield f"sd_{axis}_rad_s", channel.sd_rad_s, "rad/s", None, None
            yield f"noise_{axis}_rad_s", channel.noise_rad_s, "rad/s", None, "less"
        yield from _times("latency", sensor.latency_us)


def _of_trace(found: "Diagnosis") -> Iterator[_Told]:
    for part, fit in (("before", found.held_out.before), ("after", found.held_out.after)):
        yield f"ratio_{part}", fit.ratio, "", None, "less"
        yield f"innovation_rms_{part}", fit.innovation_rms, found.sense_unit, None, "less"
        yield f"angle_error_rms_rad_{part}", fit.angle_error_rms_rad, "rad", None, "less"
        yield f"rate_error_rms_rad_s_{part}", fit.rate_error_rms_rad_s, "rad/s", None, "less"
    yield "angle_moved_rad", found.angle_moved_rad, "rad", None, "less"
    yield "share", found.share, "", None, "more"
    yield "effects", len(found.effects), "", None, None
    yield "samples", found.samples, "", None, None
    for effect in found.effects:
        yield f"{effect.name}.evidence", effect.evidence, "", None, None
        for symbol, one in effect.coefficients.items():
            yield f"{effect.name}.{symbol}", one.value, one.unit, _half_of(one), None


def _times(name: str, times: Percentiles | None) -> Iterator[_Told]:
    if times is not None:
        for share, value in (("p50", times.p50), ("p99", times.p99), ("p999", times.p999)):
            yield f"{name}_{share}_us", value, "µs", None, "less"


def _half_of(one: "Coefficient") -> float | None:
    low, high = one.ci95
    return None if low is None or high is None else 0.5 * (high - low)
