"""A run beside the commercial gyro recorded with it: the reference's rate on bench time, and the device's beside it.

Three clocks stand between the two: the sensor's own count, this machine's, by which its samples were read, and the
board's. A sample is never read before it was sent: of many parts of the record only the one that was read soonest after
the sensor's own time tells the relation of the first two (D. Mills et al., RFC 5905, section 10, and `clock_fit`).
"""

import math
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from estimator.characteristics.regression import Fitted, fitted
from hil.bench import Bench
from hil.numbers import SD_95
from hil.records.result import Parameter, Reference, Sensor
from hil.records.runfolder import RunFolder

Floats = npt.NDArray[np.float64]

LOST = 1e-3
"""Share of its samples beyond which a reference is complained of."""

_PARTS, _LEAST_S = 40, 0.5  # parts of a record whose soonest sample counts; a shorter one tells no relation
_GAP = 3.5  # of its samples: across a longer distance its rate is not known
_SEARCH_S, _STEPS = 0.3, 121  # delays that are tried before one is fitted
_ROWS = 20_000
_MOVES = 20.0  # times what the fit leaves: a reference that turns by less tells no delay


class ReferenceRate(NamedTuple):
    """At bench time t_s (n,) the rate (n,) in rad/s, by axis and sign of the bench file; u_s: standard uncertainty of
    t_s as a whole; skew of the sensor's clock beside this machine's; step_s of its samples."""

    t_s: Floats
    rate_rad_s: Floats
    u_s: float
    skew: float
    step_s: float

    def at(self, t_s: Floats) -> Floats:
        """Straight between its samples, not a number where two of them are far apart or none is (n,)."""
        place = np.clip(np.searchsorted(self.t_s, t_s), 1, self.t_s.size - 1)
        apart = self.t_s[place] - self.t_s[place - 1]
        inside = (apart <= _GAP * self.step_s) & (t_s >= self.t_s[0]) & (t_s <= self.t_s[-1])
        return np.asarray(np.where(inside, np.interp(t_s, self.t_s, self.rate_rad_s), np.nan))

    def turned(self, t_s: Floats) -> Floats:
        """Its integral from its first sample on at t_s (n,); straight across gaps."""
        steps = 0.5 * (self.rate_rad_s[1:] + self.rate_rad_s[:-1]) * np.diff(self.t_s)
        angle = np.concatenate([[0.0], np.cumsum(steps)])
        return np.asarray(np.interp(t_s, self.t_s, angle, left=np.nan, right=np.nan))


def reference_rate(folder: RunFolder) -> ReferenceRate | str:
    """Of the commercial gyro beside a run; in words why there is none."""
    capture, clock = folder.reference, folder.clock
    if capture is None or "host_ns" not in capture.columns:
        return "no reference was recorded"
    told = folder.bench.get("reference", {})
    axis, sign = str(told.get("axis", "z")), float(told.get("sign", 1))
    if f"rate_{axis}_code" not in capture.columns:
        return f"it has no rate {axis}"
    if clock is None or (fit := clock.fit) is None:
        return "the board's clock is not known beside this machine's"
    host_ns, tick = capture.columns["host_ns"], capture.tick
    sensor_s = tick / capture.tick_rate_Hz
    if tick.size < _PARTS or sensor_s[-1] - sensor_s[0] < _LEAST_S:
        return f"{tick.size} samples of it are too few"
    late_s = 1e-9 * (host_ns - host_ns[0]) - (sensor_s - sensor_s[0])
    slope, offset, scatter_s = _soonest(sensor_s - sensor_s[0], late_s)
    latency = capture.columns["latency_us"]
    line_s = float(capture.header["identity"].get("line_s", 0.0))
    before_s = 0.5 * line_s + 1e-6 * float(np.median(np.maximum(latency, 0)))
    read_ns = host_ns[0] + 1e9 * ((1.0 + slope) * (sensor_s - sensor_s[0]) + offset - before_s)
    board_ns = read_ns + fit.offset_ns + fit.skew * (read_ns - fit.at_host_ns)
    counting = clock.tick > clock.tick[0]  # before its first sample a board counts no ticks
    if not counting.any():
        return "the board told its time only before its first sample"
    told_s = clock.tick[counting] / clock.tick_rate_Hz - 1e-9 * clock.columns["board_ns"][counting]
    zero_s = float(np.median(told_s))
    parts = (scatter_s, line_s / math.sqrt(12.0), 1e-9 * fit.offset_uncertainty_ns / 2.0,
             1.0 / clock.tick_rate_Hz / math.sqrt(12.0))  # fmt: skip
    scale = float(capture.header["columns"][f"rate_{axis}_code"]["scale"])
    rate = sign * scale * capture.columns[f"rate_{axis}_code"]
    u_s = math.sqrt(sum(part**2 for part in parts))
    return ReferenceRate(1e-9 * board_ns + zero_s, rate, u_s, -slope, 1.0 / capture.tick_rate_Hz)


def _soonest(at_s: Floats, late_s: Floats) -> tuple[float, float, float]:
    """Slope and offset of the line through the soonest samples of the parts, and how they scatter about it."""
    part = np.minimum((at_s / at_s[-1] * _PARTS).astype(int), _PARTS - 1)
    rows = np.array([np.flatnonzero(part == k)[np.argmin(late_s[part == k])] for k in np.unique(part)])
    for _ in range(3):
        slope, offset = np.polyfit(at_s[rows], late_s[rows], 1)
        left = late_s[rows] - slope * at_s[rows] - offset
        kept = left <= max(2.0 * float(np.median(np.abs(left))), 1e-6)  # what waited came late, never early
        if kept.all() or np.count_nonzero(kept) < 4:
            break
        rows = rows[kept]
    return float(slope), float(offset), float(np.std(left))


def compared(folder: RunFolder, bench: Bench, told: Mapping[str, Any]) -> Reference:
    """The device beside the reference of its run; `told` is what its recorder said of it."""
    wanted = bench.reference
    sensor = told.get("sensor")
    stopped = str(told.get("stopped", "") or told.get("error", ""))
    beside = Reference(
        link=str(wanted.link), axis=wanted.axis, sign=wanted.sign, samples=told.get("samples", 0),
        lost=told.get("lost", 0), silent_s=told.get("silent_s", 0.0), stopped=stopped,
        counters=told.get("counters", {}), sensor=None if sensor is None else Sensor.model_validate(sensor),
    )  # fmt: skip
    reference = reference_rate(folder)
    estimates = folder.estimates
    if isinstance(reference, str) or estimates is None or "rate_rad_s" not in estimates:
        return beside.model_copy(
            update={"unknown": reference if isinstance(reference, str) else "no rate is estimated"}
        )
    t_s, rate = estimates.t_s, np.asarray(estimates["rate_rad_s"], float)
    scored = (t_s >= folder.scored_from_s) & np.isfinite(rate)
    delay_s, fit = _fitted(t_s[scored], rate[scored], reference)
    if fit is None:
        return beside.model_copy(update={"unknown": "it does not cover the scored window"})
    u_s = 1e3 * reference.u_s
    found: dict[str, Any] = {
        "time_u_ms": u_s, "skew_ppm": 1e6 * reference.skew, "bias": _parameter(fit, "bias", "rad/s"),
        "scale_error": _parameter(fit, "scale", ""), "rate_rms_rad_s": float(np.sqrt(np.mean(fit.residual**2))),
    }  # fmt: skip
    if (fine := _parameter(fit, "delay", "ms", 1e3 / (1.0 + fit.of("scale")))) is not None:
        value = 1e3 * delay_s + fine.value
        half = math.hypot(0.5 * (fine.ci95[1] - fine.ci95[0]), SD_95 * u_s)
        found["delay"] = Parameter(value=value, ci95=(value - half, value + half), unit="ms")
    if "angle_rad" in estimates:
        off = np.asarray(estimates["angle_rad"], float)[scored] - reference.turned(t_s[scored] - delay_s)
        off = off[np.isfinite(off)]
        found["angle_rms_rad"] = float(np.sqrt(np.mean((off - off[0]) ** 2))) if off.size else None
    return beside.model_copy(update=found)


def _fitted(t_s: Floats, rate: Floats, reference: ReferenceRate) -> tuple[float, Fitted | None]:
    """The delay that was tried which leaves least, and the fit about it: bias, scale, delay as far as they are told."""
    every = max(1, t_s.size // _ROWS)

    def columns(delay_s: float, stride: int) -> tuple[Floats, Floats, Floats]:
        at = t_s[::stride] - delay_s
        known, ahead, behind = (
            reference.at(at),
            reference.at(at + reference.step_s),
            reference.at(at - reference.step_s),
        )
        slope = (ahead - behind) / (2.0 * reference.step_s)
        there = np.isfinite(slope) & np.isfinite(known)
        return rate[::stride][there], known[there], slope[there]

    own, known, _ = columns(0.0, every)
    if own.size < 10:
        return 0.0, None

    def left(delay_s: float) -> float:
        own, known, _ = columns(delay_s, every)
        if own.size < 10:
            return math.inf
        about = known - known.mean()
        slope = float(about @ own) / max(float(about @ about), 1e-300)
        if slope < 0.0:  # the other way about: half a period of a sine would look as good
            return math.inf
        return float(np.mean((own - own.mean() - slope * about) ** 2))

    tried = np.linspace(-_SEARCH_S, _SEARCH_S, _STEPS)
    squares = np.array([left(float(one)) for one in tried])
    best = int(np.argmin(squares))
    moves = bool(np.var(known) > _MOVES * squares[best])
    delay_s = float(tried[best]) if moves else 0.0
    moves |= not math.isfinite(squares[best])  # mounted the other way about: the scale says so
    own, known, slope = columns(delay_s, 1)
    basis: dict[str, Floats] = {"bias": np.ones(own.size)}
    if moves:
        basis |= {"scale": known, "delay": -slope}
    return delay_s, fitted(basis, own - known)


def _parameter(fit: Fitted, name: str, unit: str, scale: float = 1.0) -> Parameter | None:
    if name not in fit.names:
        return None
    value, half = scale * fit.of(name), SD_95 * abs(scale) * fit.sd(name)
    return Parameter(value=value, ci95=(value - half, value + half), unit=unit)


def complaints_of(told: Mapping[str, Any]) -> Iterator[str]:
    """What went wrong with a reference, one line each; nothing of it touches the run."""
    if "error" in told:
        yield f"reference: {told['error']}"
        return
    if told["stopped"]:
        yield f"reference: it ended before the run, {told['stopped']}"
    if told["silent_s"] > 0.5:
        yield f"reference: it was silent for {told['silent_s']:.2g} s"
    if told["lost"] > LOST * (told["samples"] + told["lost"]):
        yield f"reference: {told['lost']} of its samples are missing"
    counters = told["counters"]
    if damaged := counters.get("crc_errors", 0):
        yield f"reference: {damaged} of its frames had a wrong checksum or were cut"
    if restarts := counters.get("restarts", 0):
        yield f"reference: its counter began anew, {restarts} times"
    for complaint, count in told["sensor"]["status"].items():
        yield f"reference: it reports {complaint}, in {count} samples"
