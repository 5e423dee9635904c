"""Whether a record can be traced at all, and up to where; where not, what to record instead."""

import math

import numpy as np

from estimator.chance import chi2_isf
from estimator.errors import ModelError
from estimator.record import Record
from estimator.residual.spectrum import summed_power
from estimator.scaling import Array
from estimator.settings import Device
from estimator.thresholds import THRESHOLDS

_SET = THRESHOLDS.fitness
FEWEST = 4
"""Samples before a stretch, of which three make a parabola."""
ALIASED = 4.0
"""Samples a cycle, below which the third harmonic folds onto the resonance."""
_STRETCHES = 200  # at the end of the scale: the median of so many no longer changes


def require_traceable(record: Record, device: Device, split: int) -> None:
    """Refuse a record that is too short, unexcited, clipped, full of holes, or sampled too slowly.

    split: first sample of the part that is held out.  Raises ModelError with what is wrong and what to record instead.
    """
    _require_numbers(record)
    _require_samples_per_cycle(record, device)
    require_length(record, device, split)
    for axis in range(record.sense.shape[1]):
        name = f"sense channel {'xy'[axis]}"
        series = record.sense[:, axis]
        _require_whole_tops(series[np.isfinite(series)], name)
    _require_excitation(record, device)


def require_length(record: Record, device: Device, split: int) -> None:
    """Refuse a record of which one of the two parts is too short; split: first sample of the one that is held out.

    Raises ModelError with how long a record is needed.
    """
    fewest = 0.0 if device.axes == 1 else _SET.fewest_cycles
    frequency = math.sqrt(max(device.target, 0.0)) / (2.0 * math.pi)
    needed = max(fewest / frequency if frequency else 0.0, _SET.fewest_samples * float(np.mean(record.step)))
    share = min(split, len(record) - split) / max(len(record), 1)
    for part, steps in (("fitted", record.step[:split]), ("held out", record.step[split:])):
        cycles = float(np.sum(steps)) * frequency
        if cycles < fewest or len(steps) < _SET.fewest_samples:
            longer = f"record {1.01 * needed / share:.2g} s or longer" if share else "hold less of it out"
            raise ModelError(
                f"too short: the part to be {part} has {len(steps)} samples, {cycles:.3g} cycles of the resonance; "
                f"{longer}"
            )


def _require_numbers(record: Record) -> None:
    lost = 1.0 - float(np.mean(np.all(np.isfinite(record.sense), axis=1))) if len(record) else 0.0
    if lost > _SET.lost_share:
        raise ModelError(f"{lost:.0%} of the samples are lost; mend the link and record again")


def _require_samples_per_cycle(record: Record, device: Device) -> None:
    """By the declared resonance, and by the strongest line of the record itself."""
    rate = 1.0 / float(np.median(record.step))
    resonance = math.sqrt(max(device.target, 0.0)) / (2.0 * math.pi)
    seen = _strongest(record.sense, rate) if len(record) >= _SET.fewest_samples else 0.0
    for frequency, whose in ((resonance, "the declared resonance"), (seen, "the record's strongest line")):
        if frequency * ALIASED > rate * (1.0 + 1e-9):
            raise ModelError(
                f"sampled too slowly: {rate / frequency:.3g} samples a cycle of {frequency:.4g} Hz, {whose}; "
                f"record at {ALIASED * frequency:.3g} Hz or faster, best at 20 samples a cycle"
            )


def _strongest(sense: Array, rate: float) -> float:
    """Frequency [Hz] of the largest line over all channels, 0 where none holds much of the power."""
    power = summed_power(sense)
    peak = int(np.argmax(power))
    bins = 2  # to either side: the lobe of a Hann window
    lobe = float(np.sum(power[max(peak - bins, 0) : peak + bins + 1]))
    return peak * rate / len(sense) if lobe > THRESHOLDS.criterion.part * float(np.sum(power)) else 0.0


def _require_whole_tops(series: Array, name: str) -> None:
    """A cut-off top leaves many samples at exactly one value, and few just below it, and is reached at speed."""
    if not len(series):
        return
    cut = 0
    for values in (series, -series):
        codes, counts = np.unique(values, return_counts=True)
        beside = counts[-1 - _SET.end_codes : -1]
        crowded = len(beside) and counts[-1] > max(_SET.end_samples, np.sum(beside))
        if crowded and reached_at_speed(values, float(np.median(np.diff(codes)))):
            cut += int(counts[-1])
    if cut > _SET.clipped_share * len(series):
        raise ModelError(
            f"{name} is clipped: {cut / len(series):.2%} of the samples lie at the end of the scale; "
            "record with a smaller amplitude, a lower gain or a wider converter"
        )


def remarks(record: Record, device: Device) -> tuple[str, ...]:
    """What is odd about the samples and no reason to refuse them: a motion that stands still, codes that are coarse."""
    said = []
    for axis, noise in enumerate(device.noise):
        series = record.sense[:, axis]
        series = series[np.isfinite(series)]
        if len(series) < _SET.fewest_samples:
            continue
        name, unit = f"sense channel {'xy'[axis]}", device.sense_unit
        code = common_code(series)
        if code > math.sqrt(12.0) * noise:
            rounding = code / math.sqrt(12.0)
            said.append(
                f"{name} comes in codes of {code:.3g} {unit}, which is a noise of {rounding:.3g} {unit} by itself; "
                f"declare that much at least, not {noise:.3g} {unit}"
            )
            continue
        still = longest_stand(series)
        moving = len(series) // max(int(np.sum(np.diff(series) != 0.0)), 1)
        if still > max(_SET.end_samples, 4 * moving):
            said.append(f"{name} stands still for up to {still} samples at a time: it is held, and not clipped")
    return tuple(said)


def common_code(series: Array) -> float:
    """The largest number of which all steps between samples are multiples to within the rounding of single precision;
    0: none, or there are not fewer values than samples.
    """
    steps = np.diff(np.unique(series))
    rounding = 2.0 * float(np.finfo(np.float32).eps * np.max(np.abs(series)))
    steps = steps[steps > rounding]
    if not 0 < len(steps) < len(series) // 2:
        return 0.0
    code, left = 0.0, steps
    while len(left):  # Euclid's algorithm
        code = float(np.min(left))
        left = np.abs(steps - code * np.round(steps / code))
        left = left[left > rounding]
    return code


def longest_stand(series: Array) -> int:
    """The most samples in a row that are equal."""
    edges = np.flatnonzero(np.diff(series) != 0.0)
    return int(np.max(np.diff(np.concatenate([[-1], edges, [len(series) - 1]]))))


def reached_at_speed(values: Array, code: float) -> bool:
    """Whether a series runs into its largest value as into a wall, as one that is cut off does.

    The parabola through the samples before each stretch at that value is carried on over the stretch.  Of what comes to
    rest there (friction that holds) it does not lead beyond the value by more than a few codes; of what was cut off it
    does, half of the times at least.
    """
    top = np.max(values)
    at_top = np.concatenate([[False], values == top, [False]])
    first, after = np.flatnonzero(np.diff(at_top)).reshape(-1, 2).T
    beyond = []
    for begin, end in zip(first[:_STRETCHES], after[:_STRETCHES], strict=True):
        before = min(max(end - begin, FEWEST), _SET.end_samples)
        if begin >= before:
            parabola = np.polyfit(np.arange(-before, 0), values[begin - before : begin] - top, 2)
            beyond.append(np.max(np.polyval(parabola, np.arange(min(end - begin, before)))))
    return bool(beyond) and bool(np.median(beyond) > _SET.end_codes * code)


def _require_excitation(record: Record, device: Device) -> None:
    moved = np.nanstd(record.sense, axis=0)
    noise = np.array(device.noise)
    if np.all(moved < _SET.moves * noise):
        raise ModelError(
            f"nothing moves: {np.max(moved):.3g} {device.sense_unit} rms where the declared noise is "
            f"{np.max(noise):.3g} {device.sense_unit}; "
            "record with the drive on, or ring the mass down"
        )


def moves_until(record: Record, device: Device) -> int:
    """How many samples of a free response show a motion that comes to rest, which tells no more of what stopped it: up
    to the last stretch of some cycles of the declared resonance that shows more than the declared noise about one
    value, in which it stops.  All where a drive acts, and where it moves to the end.

    Where nothing moves, the sum of squares of n samples over the variance of the noise is χ² of n − 1 degrees.
    """
    samples = len(record)
    if np.any(record.drive) or device.target <= 0.0:
        return samples
    period = 2.0 * math.pi / math.sqrt(device.target)
    length = max(round(THRESHOLDS.start.cycles * period / float(np.median(record.step))), 2)
    stretches = samples // length
    last = -1
    for series, noise in zip(record.sense.T, device.noise, strict=True):
        rows = series[: stretches * length].reshape(stretches, length)
        seen = np.sum(np.isfinite(rows), axis=1)
        mean = np.nansum(rows, axis=1) / np.maximum(seen, 1)
        squares = np.nansum((rows - mean[:, None]) ** 2, axis=1) / noise**2
        chance = THRESHOLDS.criterion.chance / max(stretches, 1)
        least = np.array([chi2_isf(chance, float(max(count - 1, 1))) for count in seen])
        moving = np.flatnonzero(squares > least)
        last = int(np.max(moving, initial=last))
    return samples if last >= stretches - 1 else max(last, 0) * length
