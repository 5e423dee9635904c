"""What is left in the innovation of a record: one look at everything, with one stated chance of a false alarm."""

import math
from dataclasses import replace

import numpy as np

from estimator.diagnosis import Finding, Fit
from estimator.record import Record
from estimator.residual.floor import Floor, noise_floor, repeated_noise
from estimator.residual.significance import deviations, of_many
from estimator.residual.spectrum import Band, Line, bands, lines, periodogram
from estimator.residual.whiteness import Whiteness, portmanteau, sensible_lags
from estimator.scaling import Array

FALSE_ALARM = 0.01
"""That white noise gives any finding at all."""

_SHOWN = 1e-4  # resonances: an offset from a multiple that is told
_FAMILIES = 4  # floor, portmanteau, bands, lines
_SMALLEST_POWER = -300.0  # of ten, as a chance is told
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_TINY_FLOOR = np.finfo(float).tiny


def analyse(
    innovation: Array, deviation: Array, record: Record, resonance_hz: float
) -> tuple[Fit, tuple[Finding, ...]]:
    """Noise floor, whiteness and lines of innovation (n, axes) V, predicted with deviation (n, axes) V.

    Findings come largest first; white noise gives any of them with a chance of at most `FALSE_ALARM`.
    """
    sample_rate = 1.0 / float(np.mean(record.step))
    cycle = sample_rate / resonance_hz
    levelled = _levelled(innovation, deviation)
    spectrum = periodogram(levelled, sample_rate, resonance_hz)
    repeats = repeated_noise(record.sense, record.drive[:, :, 0])
    floor = noise_floor(spectrum, deviation, sample_rate, resonance_hz, repeats, filtered=record.filtered)
    white = portmanteau(levelled, sensible_lags(len(levelled), cycle))
    share = FALSE_ALARM / _FAMILIES
    fit = fit_of(innovation, floor, white)
    found = [
        *_of_level(fit, floor, deviation, len(innovation), share),
        *_of_whiteness(white, fit, share),
        *_of_lines(
            bands(spectrum, sample_rate, resonance_hz),
            lines(spectrum, sample_rate, resonance_hz, share),
            resonance_hz,
            share,
        ),
    ]
    # As the rms of the fit: the mean over the axes.
    found = [replace(finding, size=finding.size / math.sqrt(innovation.shape[1])) for finding in found]
    return fit, tuple(sorted(found, key=lambda finding: -finding.size))


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
            found.append(Finding("level", text, size, significance))
    return found


def _of_whiteness(white: Whiteness, fit: Fit, share: float) -> list[Finding]:
    if white.log_p >= math.log(share):
        return []
    total = math.sqrt(sum(rms * rms for rms in fit.innovation_rms))
    text = f"autocorrelated (Ljung–Box, p {_chance(white.log_p)})"
    return [Finding("whiteness", text, total, deviations(white.log_p))]


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
            if abs(here[0].offset) > _SHOWN * resonance:
                text += f", {_signed(here[0].offset, 3)} Hz from it"
        size = max([band.rms, *(line.rms for line in here)])
        found.append(Finding("line", text, size, deviations(log_p)))
    for line in single:
        if line.order is None:
            ratio = line.frequency / resonance
            text = f"a line at {line.frequency:.7g} Hz, {ratio:.4g} × the resonance, not a multiple of it"
            found.append(Finding("line", text, line.rms, deviations(line.log_p)))
    return found


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
