"""What is left in the innovation of a record: one look at everything, with one stated chance of a false alarm."""

import math

import numpy as np

from estimator.diagnosis import Finding, Fit, Residual
from estimator.observer import Estimates
from estimator.record import Record
from estimator.residual import demodulation
from estimator.residual.dependence import CONSTANT, Dependence, dependences
from estimator.residual.floor import Floor, noise_floor, repeated_noise
from estimator.residual.significance import deviations, of_many
from estimator.residual.spectrum import Band, Line, bands, density, lines, periodogram
from estimator.residual.suspects import suspects
from estimator.residual.whiteness import Whiteness, cumulative_periodogram, portmanteau, sensible_lags
from estimator.scaling import Array
from estimator.thresholds import THRESHOLDS

_SET = THRESHOLDS.residual

_FAMILIES = 7  # floor, portmanteau, cumulative periodogram, bands, lines, dependence on motion, dependence on drive
_SMALLEST_POWER = -300.0  # of ten, as a chance is told
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_TINY_FLOOR = np.finfo(float).tiny


def analyse(
    innovation: Array, deviation: Array, estimates: Estimates, record: Record, resonance_hz: float
) -> tuple[Fit, tuple[Finding, ...], Residual]:
    """Noise floor, whiteness, lines and dependences of innovation (n, axes) V, predicted with deviation (n, axes) V.

    estimates: of the same n samples of `record`, the state at least twice a cycle.  Findings come largest first; white
    noise gives any of them with a chance of at most `residual.false_alarm`.

    Raises ModelError for states too far apart to tell the phase of the motion.
    """
    sample_rate = 1.0 / float(np.mean(record.step))
    cycle = sample_rate / resonance_hz
    levelled = _levelled(innovation, deviation)
    spectrum = periodogram(levelled, sample_rate, resonance_hz)
    repeats = repeated_noise(record.sense, record.drive[:, :, 0])
    floor = noise_floor(spectrum, deviation, sample_rate, resonance_hz, repeats, filtered=record.filtered)
    white = portmanteau(levelled, sensible_lags(len(levelled), cycle))
    share = _SET.false_alarm / _FAMILIES
    fit = fit_of(innovation, floor, white)
    found = [
        *_of_level(fit, floor, deviation, len(innovation), share),
        *_of_whiteness(levelled, white, fit, share),
        *_of_lines(
            bands(spectrum, sample_rate, resonance_hz),
            lines(spectrum, sample_rate, resonance_hz, share),
            resonance_hz,
            share,
        ),
        *_of_motion(levelled, estimates, record, cycle, share),
        *_of_drive(levelled, estimates, record, share),
    ]
    residual = Residual(innovation, *density(innovation, sample_rate))
    return fit, tuple(sorted(found, key=lambda finding: -finding.size)), residual


def fit_of(innovation: Array, floor: Floor, white: Whiteness) -> Fit:
    """rms beside the floor, per channel and together."""
    rms = np.sqrt(np.nanmean(innovation**2, axis=0))
    ratio = float(np.sqrt(np.mean((rms / np.maximum(floor.rms, _TINY_FLOOR)) ** 2)))
    return Fit(tuple(map(float, rms)), tuple(map(float, floor.rms)), ratio, white.p, floor_from=floor.source)


def _levelled(innovation: Array, deviation: Array) -> Array:
    """The innovation as it would be, had the observer been equally sure at every sample.

    After a gap its prediction is wide, and what comes then is large by right.
    """
    usual = np.nanmedian(deviation, axis=0)
    return np.asarray(innovation * (usual / np.where(deviation > usual, deviation, usual)))


def _of_level(fit: Fit, floor: Floor, deviation: Array, samples: int, share: float) -> list[Finding]:
    found = []
    axes = len(fit.innovation_rms)
    spread = math.hypot(math.sqrt(2.0 / (samples * axes)), 2.0 * floor.uncertainty)
    excess = math.sqrt(sum(max(a * a - b * b, 0.0) for a, b in zip(fit.innovation_rms, fit.noise_floor, strict=True)))
    significance = (fit.ratio**2 - 1.0) / spread
    if significance > deviations(math.log(share / 2.0)):
        text = f"the innovation is {fit.ratio:.3g} × the noise floor ({floor.source})"
        found.append(Finding("level", text, excess, significance))
    if floor.source.startswith("the spectrum"):
        declared = np.nanmedian(deviation, axis=0)
        over = float(np.sqrt(np.mean((np.array(fit.noise_floor) / declared) ** 2)))
        significance = (over**2 - 1.0) / (2.0 * floor.uncertainty)
        if significance > deviations(math.log(share / 2.0)):
            text = f"the noise floor itself is {over:.3g} × what the declared noise gives"
            size = float(np.sqrt(max(np.sum(np.array(fit.noise_floor) ** 2 - declared**2), 0.0)))
            found.append(Finding("level", text, size, significance, suspects("floor")))
    return found


def _of_whiteness(series: Array, white: Whiteness, fit: Fit, share: float) -> list[Finding]:
    total = math.sqrt(sum(rms * rms for rms in fit.innovation_rms))
    found = []
    if white.log_p < math.log(share):
        text = f"autocorrelated (Ljung–Box, p {_chance(white.log_p)})"
        found.append(Finding("whiteness", text, total, deviations(white.log_p)))
    lopsided = min((cumulative_periodogram(column) for column in series.T), key=lambda test: test.log_p)
    log_p = of_many(lopsided.log_p, series.shape[1])
    if log_p < math.log(share):
        text = f"its spectrum is not flat as a whole (cumulative periodogram, p {_chance(log_p)})"
        found.append(Finding("whiteness", text, total, deviations(log_p)))
    return found


def _of_lines(around: tuple[Band, ...], single: tuple[Line, ...], resonance: float, share: float) -> list[Finding]:
    found = []
    for band in around:
        here = [line for line in single if line.order == band.order]
        log_p = min([of_many(band.log_p, len(around)), *(line.log_p for line in here)])
        if log_p >= math.log(share):
            continue
        text = f"around {_multiple(band.order)} ({band.frequency:.6g} Hz)"
        if here:
            text += f"; {_count(len(here))}, strongest at {here[0].frequency:.7g} Hz"
            if abs(here[0].offset) > _SET.shown_offset * resonance:
                text += f", {_signed(here[0].offset, 3)} Hz beside it"
        size = max([band.rms, *(line.rms for line in here)])
        points_at = suspects(f"line at {band.order}")
        if len(here) == 1 and abs(here[0].offset) > _SET.beside_multiple * resonance:
            points_at += suspects("line elsewhere")
        found.append(Finding("line", text, size, deviations(log_p), points_at))
    for line in single:
        if line.order is None:
            ratio = line.frequency / resonance
            text = f"a line at {line.frequency:.7g} Hz, {ratio:.4g} × the resonance, not a multiple of it"
            found.append(Finding("line", text, line.rms, deviations(line.log_p), suspects("line elsewhere")))
    return found


def _of_motion(series: Array, estimates: Estimates, record: Record, cycle: float, share: float) -> list[Finding]:
    """In step with the vibration: the part that is always there, and what it grows and turns with."""
    if len(series) < _SET.blocks * _SET.block_cycles * cycle or not np.any(estimates.of("x")):
        return []
    seen = demodulation.demodulate(series, demodulation.motion(estimates, len(series), cycle), cycle)
    regressors: dict[str, Array] = {"amplitude": seen.amplitude}
    if series.shape[1] == 2:
        for order in (2, 4):
            regressors[f"sin {order}θ"] = np.sin(order * seen.angle)
            regressors[f"cos {order}θ"] = np.cos(order * seen.angle)
    rate = _rate(estimates, record)
    if rate is not None:
        regressors["rate"] = seen.mean(rate)
    if "temperature" in record.channels:
        regressors["temperature"] = seen.mean(record.channels["temperature"])
    all_of_them = dependences(seen.components, regressors)
    tries = len(all_of_them)
    found = []
    for name in (CONSTANT, *regressors):
        of_it = [entry for entry in all_of_them if entry.regressor == name]
        if not of_it:
            continue
        best = min(of_it, key=lambda entry: entry.log_p)
        log_p = of_many(best.log_p, tries)
        if log_p < math.log(share):
            found.append(_moves_with(best, log_p))
    return found


def _moves_with(entry: Dependence, log_p: float) -> Finding:
    kind = {CONSTANT: "amplitude"}.get(entry.regressor, entry.regressor)
    if kind not in ("amplitude", "rate", "temperature"):
        kind = "orientation"
    what = f"follows the {entry.regressor}" if entry.regressor == kind else f"follows {entry.regressor}"
    what = "is always there" if entry.regressor == CONSTANT else what
    phase, side = entry.component.split(", ")
    text = f"at the resonance, a part {phase} with the motion and {side} it {what} (t = {_signed(entry.t, 3)})"
    return Finding(kind, text, abs(entry.slope) / math.sqrt(2.0), deviations(log_p), suspects(entry.regressor))


def _of_drive(series: Array, estimates: Estimates, record: Record, share: float) -> list[Finding]:
    """Sample by sample, what the drive of the interval just past adds, with the motion itself taken out."""
    if len(estimates.index) < len(series):
        return []
    rows = slice(max(len(series) - _SET.regressed, 0), None)
    series, drive = series[rows], np.asarray(record.drive[rows, :, 0])
    states = [name for name in ("x", "vx", "y", "vy") if name in estimates.names]
    axes = "xy"[: series.shape[1]]
    regressors = {f"u{axis}": drive[:, i] for i, axis in enumerate(axes)}
    valid = np.all(np.isfinite(series), axis=1)
    moving = {name: estimates.of(name)[rows][valid] for name in states}
    components = {f"ν{axis}": series[valid, i] for i, axis in enumerate(axes)}
    entries = dependences(components, moving | {name: values[valid] for name, values in regressors.items()})
    entries = tuple(entry for entry in entries if entry.regressor in regressors)
    if not entries:
        return []
    best = min(entries, key=lambda entry: entry.log_p)
    log_p = of_many(best.log_p, len(entries))
    if log_p >= math.log(share):
        return []
    text = f"{best.component} follows the drive {best.regressor} without delay (t = {_signed(best.t, 3)})"
    return [Finding("drive", text, abs(best.slope), deviations(log_p), suspects("drive"))]


def _rate(estimates: Estimates, record: Record) -> Array | None:
    if "rate" in record.channels:
        return record.channels["rate"]
    if "rate" not in estimates.names:
        return None
    return np.interp(np.arange(len(record)), estimates.index, estimates.of("rate"))


def _multiple(order: int) -> str:
    return {0: "zero frequency", 1: "the resonance"}.get(order, f"{order} × the resonance")


def _count(lines_there: int) -> str:
    return "one line" if lines_there == 1 else f"{lines_there} lines"


def _chance(log_p: float) -> str:
    power = log_p / math.log(10.0)
    if power > -4.0:
        return f"= {math.exp(log_p):.2g}"
    exponent = f"{max(power, _SMALLEST_POWER):.0f}".translate(_RAISED)
    return f"{'<' if power < _SMALLEST_POWER else '='} 10{exponent}"


def _signed(value: float, digits: int) -> str:
    """With its sign, a minus being one and no hyphen."""
    return f"{value:+.{digits}g}".replace("-", "−")
