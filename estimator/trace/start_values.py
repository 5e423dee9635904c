"""What to watch for on a record: every effect of the catalogue, those with parameters at several values of them.

Where the values come from, an effect's declaration says (`Search`): a frequency from the residual's lines and from
where it follows the drive, a threshold from how far drive and signal reach.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.effects.search import Search
from estimator.record import Record
from estimator.residual.averaged import cross_density, power_density
from estimator.residual.spectrum import LOBE, lines, periodogram
from estimator.scaling import Array
from estimator.settings import Device
from estimator.thresholds import THRESHOLDS

_SET = THRESHOLDS.candidates
_ROUNDS = 5  # after which a denominator's weights change no more

Parameters = dict[str, float]
Values = Sequence[tuple[str, tuple[float, ...]]]
"""At which values an effect is watched, each with its label: one for all of its parameters, or one each."""


def labelled(shares: Sequence[float], of: float) -> Values:
    """These shares of a quantity, numbered from 1."""
    return [(str(label), (share * of,)) for label, share in enumerate(shares, start=1)]


def of_lines(record: Record, device: Device, whitened: Array) -> Values:
    """Frequencies of the strongest lines of whitened innovations (n, axes), rad/s."""
    sample_rate = 1.0 / float(np.mean(record.step))
    resonance = float(np.sqrt(device.target)) / (2.0 * np.pi)
    found = lines(periodogram(whitened, sample_rate, resonance), sample_rate, resonance, THRESHOLDS.criterion.chance)
    span = float(np.sum(record.step))
    steady = [line for line in found if line.frequency * span > 2.0 * LOBE]  # else it is a drift: one with the mean
    strongest = sorted(steady, key=lambda line: -line.rms)[: _SET.strongest]
    return labelled([2.0 * np.pi * line.frequency for line in strongest], 1.0)


def of_thresholds(record: Record, device: Device) -> dict[Search, Values]:
    """Limits and bands by how far the drive reaches, levels by how far the sensed displacement does."""
    values: dict[Search, Values] = {}
    drive = np.abs(record.drive[:, :, 0]) * device.drive_gain
    if np.any(drive):
        largest, usual = float(np.max(drive)), float(np.sqrt(np.mean(drive**2)))
        values[Search.LIMITS] = labelled(_SET.shares, largest)
        values[Search.BANDS] = labelled(_SET.dead_band, usual)
    reach = np.nanmax(np.abs(record.sense / np.abs(device.sense_gain)))
    return values | {Search.LEVELS: labelled(_SET.shares, float(reach))}


def of_modes(record: Record, device: Device, whitened: Array) -> Values:
    """Frequencies at which the residual follows the drive more than around them, with the damping seen there; and the
    one at which most of it does, since a mode that rings for longer than a segment follows the drive of those before.

    Not the resonance: what follows the drive there is the gyro itself, as where a gain is off, and a mode beside it
    would imitate that.  Where the drive is of the resonance alone, no peak shows: one frequency stands for all.
    """
    drive = record.drive[:, :, 0]
    if not np.any(drive):
        return []
    sample_rate = 1.0 / float(np.mean(record.step))
    length = _segment(record)
    filled = np.nan_to_num(whitened)
    coherence: Array = np.zeros(length // 2 + 1)
    following: Array = np.zeros_like(coherence)
    frequency, responses = np.zeros_like(coherence), []
    for axis in range(drive.shape[1]):
        frequency, across = cross_density(drive[:, axis], filled[:, axis], sample_rate, length)
        _, of_drive = power_density(drive[:, axis], sample_rate, length)
        _, of_residual = power_density(filled[:, axis], sample_rate, length)
        coherence = coherence + np.abs(across) ** 2 / np.maximum(of_drive * of_residual, np.finfo(float).tiny)
        following = following + np.abs(across) ** 2 / np.maximum(of_drive, np.finfo(float).tiny)
        responses.append(across / np.maximum(of_drive, np.finfo(float).tiny))
    values: list[tuple[str, tuple[float, ...]]] = []
    if of_resonance_alone(record, device):
        # What one frequency tells of a mode is the same wherever that is: midway to half the sampling rate.
        return [("1", (float(np.sqrt(np.sqrt(device.target) * np.pi * sample_rate)), _SET.damping_ratio))]
    off_resonance = ~at_resonance(record, device, 2.0 * np.pi * frequency)
    peaks = [k for k in _peaks(coherence) if off_resonance[k]][: _SET.strongest]
    loudest = [k for k in _peaks(following) if off_resonance[k]][:1]
    peaks += [k for k in loudest if all(abs(k - other) > _SET.beside_peak for other in peaks)]
    for label, peak in enumerate(peaks, start=1):
        near = slice(max(peak - _SET.beside_peak, 1), peak + _SET.beside_peak + 1)
        seen = resonance(2.0 * np.pi * frequency[near], [response[near] for response in responses])
        supposed = [(2.0 * np.pi * float(frequency[peak]), _SET.damping_ratio)]
        for which, (omega, zeta) in enumerate(supposed if seen is None else [seen, *supposed], start=1):
            values.append((f"{label}{which}", (omega, zeta)))
    return values


def rings(residuals: Sequence[Array], sample_rate: float, itself: float) -> list[tuple[float, float]]:
    """Frequency rad/s and rate of decay 1/s (of the power) of the strongest lines that residuals (n, axes) share, none
    of them at a multiple of the resonance `itself`, rad/s.
    """
    length = _SET.beside_peak * max(len(one) for one in residuals)
    channels = [np.nan_to_num(column) for one in residuals for column in one.T]
    spectra = [np.fft.rfft(column - np.mean(column), length) for column in channels]
    # Lines are told by a window, or the strongest would have others beside it; how fast one dies away, without.
    told = [np.fft.rfft((column - np.mean(column)) * np.hanning(len(column)), length) for column in channels]
    power = np.sum([np.abs(one) ** 2 for one in told], axis=0)
    omega: Array = 2.0 * np.pi * np.fft.rfftfreq(length, 1.0 / sample_rate).astype(np.float64)
    order = omega / itself
    own = (np.abs(order - np.round(order)) < THRESHOLDS.spectrum.sideband) | (order < THRESHOLDS.spectrum.sideband)
    found: list[tuple[float, float]] = []
    for top in (place for place in _peaks(power) if not own[place]):
        if len(found) == _SET.strongest:
            break
        if any(abs(omega[top] - other) < THRESHOLDS.spectrum.sideband * itself for other, _ in found):
            continue  # a side of a line that is there already
        near = slice(max(top - _SET.beside_peak, 1), top + _SET.beside_peak + 1)
        seen = resonance(omega[near], [one[near] for one in spectra])
        longest = max(len(one) for one in residuals) / sample_rate
        found.append((float(omega[top]), 2.0 / longest) if seen is None else (seen[0], 2.0 * seen[1] * seen[0]))
    return found


def _peaks(series: Array) -> list[int]:
    """Where it is larger than on either side, the largest first; `scipy.signal`, which has this too, loads for half a
    second.
    """
    inner = series[1:-1]
    peaks = 1 + np.flatnonzero((inner > series[:-2]) & (inner >= series[2:]))
    return sorted(peaks.tolist(), key=lambda k: -series[k])


def _segment(record: Record) -> int:
    """Samples from which a response to the drive is found."""
    return len(record) // _SET.segments


def at_resonance(record: Record, device: Device, omega: Array) -> NDArray[np.bool_]:
    """Whether these frequencies, rad/s, belong to the peak of the gyro's own response in a response to the drive."""
    bin_width = 2.0 * np.pi / (float(np.mean(record.step)) * _segment(record))
    return np.asarray(np.abs(omega - np.sqrt(device.target)) <= _SET.beside_peak * bin_width)


def of_resonance_alone(record: Record, device: Device) -> bool:
    """Whether the drive's power is all at the gyro's own resonance, as it is without dither."""
    sample_rate = 1.0 / float(np.mean(record.step))
    power: Array = np.zeros(_segment(record) // 2 + 1)
    frequency = np.zeros_like(power)
    for axis in range(device.axes):
        frequency, density = power_density(record.drive[:, axis, 0], sample_rate, _segment(record))
        power = power + density
    elsewhere = ~at_resonance(record, device, 2.0 * np.pi * frequency)
    return bool(np.sum(power[elsewhere]) <= _SET.off_resonance * np.sum(power))


def resonance(omega: Array, responses: list[NDArray[np.complex128]]) -> tuple[float, float] | None:
    """ω and ζ of the one mode r/(ω² − Ω² + 2jζωΩ) that responses (m,) at the frequencies Ω (m,) rad/s share, each with
    an r of its own; None where there is none.

    Least squares of the equation error, weighted anew by the denominator found (Sanathanan & Koerner, IEEE Trans.
    Automatic Control 8(1), 1963).
    """
    unit = float(np.mean(omega))
    w = omega / unit
    weight = np.ones(len(w))
    stiffness = damping = 0.0
    for _ in range(_ROUNDS):
        rows, targets = [], []
        for axis, response in enumerate(responses):
            own = np.zeros((len(w), 2 + len(responses)), dtype=complex)
            own[:, 0], own[:, 1], own[:, 2 + axis] = 1j * w * response, response, -1.0
            rows.append(own * weight[:, None])
            targets.append(w**2 * response * weight)
        matrix, target = np.concatenate(rows), np.concatenate(targets)
        solution = np.linalg.lstsq(
            np.concatenate([matrix.real, matrix.imag]), np.concatenate([target.real, target.imag]), rcond=None
        )[0]
        damping, stiffness = float(solution[0]), float(solution[1])
        weight = 1.0 / np.maximum(np.abs(stiffness - w**2 + 1j * damping * w), np.finfo(float).tiny)
    if stiffness <= 0.0 or not w[0] < np.sqrt(stiffness) < w[-1]:
        return None
    zeta = damping / (2.0 * np.sqrt(stiffness))
    # From 1/√2 on a response has no peak.
    possible = _SET.least_damping_ratio < zeta < np.sqrt(0.5)
    return (unit * float(np.sqrt(stiffness)), zeta) if possible else None
