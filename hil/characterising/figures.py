"""The figures of one axis, from its records."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from estimator.allan.deviation import AllanSums
from estimator.allan.noise import LEAST_SAMPLES, Noise, read_noise
from estimator.characteristics.rate_error import LEAST_TURNS, Line, fewest, line, passed
from estimator.characteristics.regression import Estimate
from estimator.characteristics.response import LEAST, response
from estimator.characteristics.small_rates import small_rates
from estimator.characteristics.start_up import FEWEST, start_up
from estimator.characteristics.stretches import HARMONICS, Gathered, Stretches, joined, pattern_columns
from estimator.side_by_side import stop_if_abandoned
from hil.bench.data_sheet import BY_NAME
from hil.characterising.source import Axis, Block
from hil.numbers import significant
from hil.records.data_sheet import DataSheet, SheetRow

Floats = npt.NDArray[np.float64]

_STRETCH_S, _MOST = 0.1, 100_000  # length of a stretch, and how many there may be
_ROUNDS, _CLOSE = 9, 0.05  # of moving the reference, until less than so much of the delay's interval is left
_WORSE = 1.1  # mean square of what is left: a step that leaves more goes the wrong way
_RESPONSE = 1 << 21  # samples that bandwidth and delay are read from
_FIGURE_OF = {
    "quantisation": "quantisation",
    "white": "angle_random_walk",
    "rate random walk": "rate_random_walk",
    "ramp": "rate_ramp",
}
HALVED = "half of it needs about"
AT_REST = "as of a device at rest; the Earth's rate is in it"
AT_ONE_RATE = "at the record's one rate; the scale factor error times that rate is in it"


@dataclass
class AxisFigures:
    """What the records of one axis tell: figures by name, why others are missing, and what is drawn; seconds: of the
    longest record.
    """

    axis: str
    seconds: float = 0.0
    found: dict[str, Estimate] = field(default_factory=dict)
    missing: dict[str, str] = field(default_factory=dict)
    line: Line | None = None
    stretches: Stretches | None = None
    noise: Noise | None = None
    remarks: list[str] = field(default_factory=list)
    referred: bool = False


def figures_of(records: Sequence[Axis]) -> AxisFigures:
    """Of the records of one axis; noise, response and start-up of the longest of them."""
    longest = max(range(len(records)), key=lambda number: records[number].span)
    told = AxisFigures(records[0].name, records[longest].span / records[longest].rate_Hz)
    at_rest = AllanSums(_settled_span(records[longest]))  # of a record without a reference one pass is enough
    parts = [_stretches(record, at_rest if number == longest else None) for number, record in enumerate(records)]
    as_moved, late_s, parts, told.line = _in_time(records, parts)
    told.stretches = whole = joined(parts)
    told.referred = whole.reference is not None
    why = why_missing(told.line, whole, records[longest], _stretch(records[longest]) / records[longest].rate_Hz)
    if told.line is None:
        told.missing = why
        return told
    told.found = told.line.figures()
    told.found = _later(told.found, late_s)
    if not told.referred:
        told.found["bias"] = told.found["bias"]._replace(said=AT_REST)
    elif "scale_factor_error" not in told.found and whole.reference is not None and np.any(whole.reference):
        told.found["bias"] = told.found["bias"]._replace(said=AT_ONE_RATE)
    told.found |= small_rates(told.line.levels)
    record = as_moved[longest]
    if record.steady:
        told.missing |= dict.fromkeys((*_FIGURE_OF.values(), "bias_instability", "start_up"), "rows without time")
    else:
        plain = parts[longest].reference is None and parts[longest].pattern is None
        still = _still(told.line, parts, longest, record)
        sums = at_rest if plain else _noise(told, record, still)
        if (far := sums.outliers()) is not None:
            sums = _noise(told, record, still, far.beyond)
            told.remarks.append(
                f"{record.name}: {far.number} of {far.samples} samples lie more than {_deg_per_s(far.beyond)} off, "
                f"up to {_deg_per_s(far.farthest)}; the noise figures leave them out, the others do not"
            )
        _read(told, record, sums, moves=parts[longest].moves)
        if told.referred and whole.moves:
            told.found |= _later(_response(record), late_s)
        started = _start_up(record, told, parts[longest] if len(parts) == 1 else None)
        if started is not None:
            told.found["start_up"] = started
    _turn_on(told, parts)
    told.missing = {name: reason for name, reason in (why | told.missing).items() if name not in told.found}
    return told


def _later(found: dict[str, Estimate], late_s: float) -> dict[str, Estimate]:
    """Figures of a record of which the reference was moved by so much: what is left of the delay, and that."""
    if (left := found.get("delay")) is None:
        return found
    return found | {"delay": Estimate(left.value + late_s, left.low + late_s, left.high + late_s)}


def _in_time(
    records: Sequence[Axis], parts: list[Stretches]
) -> tuple[Sequence[Axis], float, list[Stretches], Line | None]:
    """The records with their reference as late as the output is, that delay in s, their stretches and the fit to them:
    what is late by more than a first order is a smaller scale factor to a fit (1 − (ωτ)²/2 of a sine).
    """
    late_s, best, moved = 0.0, line(joined(parts)), records
    if best is None or best.delay is None:
        return records, 0.0, parts, best
    step_s, first = _rough_delay(max(records, key=lambda record: record.span)), True
    for _ in range(_ROUNDS):
        if step_s != 0.0:
            tried = [record.late_by(late_s + step_s) for record in records]
            those = [_stretches(record) for record in tried]
            found = line(joined(those))
            if found is not None and np.mean(found.fit.residual**2) < _WORSE * np.mean(best.fit.residual**2):
                moved, parts, best, late_s = tried, those, found, late_s + step_s
            elif not first:
                break
        left, first = best.delay, False
        if left is None or abs(left.value) <= _CLOSE * (left.high - left.low):
            break
        step_s = left.value
    return moved, late_s, parts, best


def _rough_delay(record: Axis) -> float:
    """How late the output is, s, to a sample: where it goes with its reference best, within a quarter of the record.  A
    fit finds no delay beyond the shortest period in it.
    """
    from scipy.signal import correlate

    rate, reference = _beginning(record)
    if rate.size < LEAST:
        return 0.0
    goes = correlate(rate - rate.mean(), reference - reference.mean(), method="fft")[rate.size - 1 :]
    return float(np.argmax(np.abs(goes[: rate.size // 4]))) / record.rate_Hz


def _settled_span(record: Axis) -> int:
    return record.first + record.span - max(record.settled_from, record.first)


def _stretch(record: Axis) -> int:
    """Ticks of a stretch."""
    return max(1, round(_STRETCH_S * record.rate_Hz), -(-record.span // _MOST))


def _stretches(record: Axis, at_rest: AllanSums | None = None) -> Stretches:
    """One pass: means over stretches; of rows without time each is one. What is told nothing of how it turned goes into
    the sums of its noise as well."""
    length = 1 if record.steady else _stretch(record)
    blocks = _settled(record)
    first = next(blocks, None)
    if first is None:
        return Stretches(np.zeros(0), np.zeros(0))
    has_reference, has_temperature, has_pattern = (part is not None for part in first[2:])
    width = 1 + 3 * has_reference + has_temperature + 4 * len(HARMONICS) * has_pattern
    gathered = Gathered(length, record.rate_Hz, width)
    while first is not None:
        if at_rest is not None and not has_reference and not has_pattern:
            at_rest.add(first.rate, first.tick)
        gathered.add(first.tick - record.first, *_columns(first, record.rate_Hz))
        first = next(blocks, None)
    t_s, means = gathered.means()
    columns = iter(means.T)
    rate = next(columns)
    reference, slope, square = (next(columns) for _ in range(3)) if has_reference else (None, None, None)
    temperature = next(columns) if has_temperature else None
    pattern = np.column_stack(list(columns)) if has_pattern else None
    spread = None if reference is None or square is None else np.sqrt(np.maximum(square - reference**2, 0.0))
    return Stretches(t_s, rate, reference, None if record.steady else slope, temperature, pattern, spread)


def _columns(block: Block, rate_Hz: float) -> list[Floats]:
    columns = [block.rate]
    if block.reference is not None:
        slope = np.gradient(block.reference, block.tick / rate_Hz) if block.tick.size > 1 else np.zeros(1)
        columns += [block.reference, slope, block.reference**2]
    if block.temperature is not None:
        columns.append(block.temperature)
    if block.theta is not None:
        turning = np.zeros(block.tick.size) if block.reference is None else block.reference
        columns += list(pattern_columns(block.theta, turning).T)
    return columns


def _settled(record: Axis) -> Iterator[Block]:
    for block in record.blocks():
        stop_if_abandoned()
        late = block.tick >= record.settled_from
        if late.all():
            yield block
        elif late.any():
            yield block.part(late)


def _left(block: Block, told: AxisFigures) -> Floats:
    """The rate less what the fit accounts for but for the bias: noise."""
    assert told.line is not None
    left = block.rate
    if block.reference is not None:
        left = left - block.reference * (1.0 + told.line.fit.of("scale"))
        if (asymmetry := told.line.fit.of("asymmetry")) != 0.0:
            left = left - asymmetry * np.abs(block.reference)
    if block.theta is not None and told.line.angles:
        turning = np.zeros(block.tick.size) if block.reference is None else block.reference
        columns = pattern_columns(block.theta, turning)
        names = [f"{kind}_{turn}{k}" for kind in ("bias", "scale") for k in HARMONICS for turn in ("cos", "sin")]
        left = left - columns @ np.array([told.line.fit.of(name) for name in names])
    return np.asarray(left)


class _Still(NamedTuple):
    """Ticks `first` to `end` at which the reference stands still, the mean of what the fit leaves there, and the tick
    in the sums: so far from the others that no cluster has parts of two."""

    first: int
    end: int
    level: float
    at: int


def _still(found: Line, parts: list[Stretches], number: int, record: Axis) -> list[_Still]:
    """Where the reference of a record stands still and the output has settled; all of one that never moves."""
    part, before = parts[number], sum(len(one) for one in parts[:number])
    if not part.moves:
        return [_Still(record.settled_from, record.first + record.span, 0.0, 0)]
    left, stretch = found.fit.residual[before : before + len(part)], _stretch(record)
    still: list[_Still] = []
    at = long = 0
    for begin, end in part.still():
        started = start_up(part.t_s[begin:end], left[begin:end])
        if started is None:
            continue
        begin += int(np.searchsorted(part.t_s[begin:end], part.t_s[begin] + started.value))
        first, last = (record.first + round(part.t_s[k] * record.rate_Hz - 0.5 * stretch) for k in (begin, end - 1))
        length = last + stretch - first
        at += max(length, long) if still else 0
        still.append(_Still(first, first + length, float(left[begin:end].mean()) + found.fit.of("bias"), at))
        at, long = at + length, length
    return still


def _noise(told: AxisFigures, record: Axis, still: list[_Still], within: float = np.inf) -> AllanSums:
    """A second pass, of what the fit leaves where the reference stands still."""
    sums = AllanSums(still[-1].at + still[-1].end - still[-1].first if still else 1, within=within)
    for block in _settled(record):
        for one in still:
            inside = slice(*np.searchsorted(block.tick, (one.first, one.end)))
            if inside.start < inside.stop:
                piece = block.part(inside)
                sums.add(_left(piece, told) - one.level, piece.tick + (one.at - one.first))
    return sums


def _deg_per_s(rate_rad_s: float) -> str:
    return f"{significant(np.degrees(rate_rad_s), 2)} °/s"


def _read(told: AxisFigures, record: Axis, sums: AllanSums, *, moves: bool) -> None:
    """What the Allan deviation tells."""
    told.noise = noise = read_noise(sums.deviation(record.rate_Hz))
    if noise.fit is None:
        why = "the Allan deviation is not that of noise alone"
        if moves and not len(noise.curve):
            why = f"the reference never stands still for {lasting(FEWEST * _stretch(record) / record.rate_Hz)}"
        if record.span < LEAST_SAMPLES:
            why = f"needs {lasting(LEAST_SAMPLES / record.rate_Hz)}"
        told.missing |= dict.fromkeys((*_FIGURE_OF.values(), "bias_instability"), why)
        return
    for term, figure in _FIGURE_OF.items():
        if term in noise.readings:
            read = noise.readings[term]
            told.found[figure] = Estimate(read.value, read.low, read.high)
        else:
            told.missing[figure] = (
                f"no stretch of the Allan deviation shows it, up to τ = {lasting(noise.told_s or 0.0)}"
            )
    if noise.bias_instability is not None:
        read = noise.bias_instability
        told.found["bias_instability"] = Estimate(read.value, read.low, read.high)
    elif noise.bias_bound_rad_s is not None:
        bound = noise.bias_bound_rad_s
        why = "other noise explains the lowest place of the Allan deviation"
        if noise.lowest_s == noise.told_s:
            why = "a record at rest gives a lower one" if moves else f"{HALVED} {lasting(4.0 * told.seconds)}"
        said = f"upper limit (95 %); {why}"
        told.found["bias_instability"] = Estimate(bound, 0.0, bound, said)


def _response(record: Axis) -> dict[str, Estimate]:
    rate, reference = _beginning(record)
    return response(rate, reference, record.rate_Hz) if rate.size else {}


def _beginning(record: Axis) -> tuple[Floats, Floats]:
    """Rate and reference (n,) of the longest beginning without a gap."""
    rates, references, count = [np.zeros(0)], [np.zeros(0)], 0
    due: int | None = None
    for block in _settled(record):
        assert block.reference is not None
        tick = block.tick
        begin = tick[0] if due is None else due
        whole = int(np.count_nonzero(np.cumprod(tick == begin + np.arange(tick.size))))
        rates.append(block.rate[:whole])
        references.append(block.reference[:whole])
        count, due = count + whole, int(begin) + whole
        if whole < tick.size or count >= _RESPONSE:
            break
    return np.concatenate(rates), np.concatenate(references)


def _start_up(record: Axis, told: AxisFigures, part: Stretches | None) -> Estimate | None:
    """Of the record from its first sample on, also where that does not count for the rest; `part`: its stretches, where
    they are all that was fitted."""
    if part is not None and record.settled_from == record.first and told.line is not None:
        return start_up(part.t_s, told.line.fit.residual)
    gathered = Gathered(_stretch(record), record.rate_Hz, 1)
    for block in record.blocks():
        gathered.add(block.tick - record.first, _left(block, told))
    t_s, means = gathered.means()
    return start_up(t_s, means[:, 0]) if t_s.size else None


def _turn_on(told: AxisFigures, parts: list[Stretches]) -> None:
    """Scatter of the bias of several records, each from a start of its own."""
    from scipy.stats import chi2

    if len(parts) < 2:
        told.missing["bias_turn_on"] = "needs several records, each after a new start"
        return
    biases = [found.fit.of("bias") for part in parts if (found := line(part)) is not None]
    if len(biases) < 2:
        return
    spread, free = float(np.std(biases, ddof=1)), len(biases) - 1
    low, high = (spread * float(np.sqrt(free / chi2.ppf(tail, free))) for tail in (0.975, 0.025))
    told.found["bias_turn_on"] = Estimate(spread, low, high, f"standard deviation over {len(biases)} records")


_CONFOUNDED = "the record does not separate it from the figures above"
_LEVEL = 3  # stretches at a rate, of which there is a mean


def lasting(seconds: float) -> str:
    """A length of time as a record would be ordered.

    >>> lasting(0.44), lasting(75.0), lasting(700.0), lasting(40_000.0)
    ('0.44 s', '75 s', '12 min', '12 h')
    """
    if seconds < 90.0:
        return f"{seconds:.2g} s"
    minutes = math.ceil(seconds / 60.0)
    return f"{minutes} min" if minutes < 90 else f"{math.ceil(minutes / 60.0)} h"


def why_missing(found: Line | None, whole: Stretches, record: Axis, stretch_s: float) -> dict[str, str]:
    """By figure.  found: the fit, if there is one; whole: stretches of all records, `stretch_s` long; record: the
    longest.
    """
    why: dict[str, str] = {}
    shortest = _long(fewest(whole), record, stretch_s)
    why["bias"], why["bias_turn_on"] = f"needs {shortest}", f"needs two records of {shortest}"
    unmoved = (
        "needs a reference that moves" if whole.reference is not None else "needs a reference: how the device rotated"
    )
    moved = ("scale_factor_error", "scale_factor_nonlinearity", "scale_factor_asymmetry", "bandwidth", "delay")
    why |= dict.fromkeys((*moved, "threshold", "dead_zone", "scale_factor_temperature"), unmoved)
    if whole.moves:
        why |= {
            "scale_factor_nonlinearity": f"needs three rates, each applied for {_long(_LEVEL, record, stretch_s)}",
            "scale_factor_asymmetry": "needs rates of both signs, and of several sizes",
            "bandwidth": "the output does not fall by 3 dB where it follows the reference",
            "delay": "no frequency at which the output follows the reference",
            "threshold": "no rate below 5 % of the largest lasted long enough to exceed the noise",
            "dead_zone": "no rate below 5 % of the largest lasted long enough to exceed the noise",
        }
        if record.span < LEAST:
            why |= dict.fromkeys(("bandwidth", "delay"), f"needs {lasting(LEAST / record.rate_Hz)}")
    cold = "needs a temperature" if whole.temperature is None else "needs a temperature that changes by 2 K"
    why["bias_temperature"] = cold
    if whole.moves:
        why["scale_factor_temperature"] = cold
    if whole.pattern is not None:
        share = passed(whole)
        longer = (
            lasting(len(whole) * stretch_s * LEAST_TURNS / share) if share > 1.0 / 16.0 else "a pattern that rotates"
        )
        every = f"the pattern passed {100.0 * share:.0f} % of half a rotation; needs about {longer}"
        why |= {f"{kind}_{k}theta": every for kind in ("bias", "scale_factor") for k in HARMONICS}
        if not whole.moves:
            why |= {f"scale_factor_{k}theta": unmoved for k in HARMONICS}
    why["start_up"] = f"needs {_long(FEWEST, record, stretch_s)}"
    return why if found is None else why | dict.fromkeys(found.confounded, _CONFOUNDED)


def _long(stretches: int, record: Axis, stretch_s: float) -> str:
    """So many stretches, behind what does not count of the record."""
    if record.steady:
        return f"{stretches} rows"
    before_s = max(record.settled_from - record.first, 0) / record.rate_Hz
    return lasting(before_s + stretches * stretch_s)


HEAD = ("axis", "figure", "value, 95 % interval", "limit", "kept", "remark")
_SPACE = "\u00a0"


def shown(row: SheetRow) -> str:
    """`0.152 °/√h (0.148 to 0.156)`: as many digits as the interval bears; `< 0.152 °/√h`: an upper limit."""
    if row.value is None or row.low is None or row.high is None:
        return "not determined"
    figure = BY_NAME[row.figure]
    value, low, high = (figure.shown(number) for number in (row.value, row.low, row.high))
    half, size = 0.5 * (high - low), max(abs(value), abs(low), abs(high))
    digits = 3 if half <= 0.0 or size == 0.0 else min(max(2 - math.floor(math.log10(half / size)), 2), 6)
    text = f"{significant(value, digits)}{_unit(row)}"
    if row.low == 0.0 < row.value == row.high:
        return f"< {text}"
    return text if half == 0.0 else f"{text} ({significant(low, digits)} to {significant(high, digits)})"


def shown_limit(row: SheetRow) -> str:
    """The limit in the same unit."""
    return "" if row.limit is None else f"{significant(BY_NAME[row.figure].shown(row.limit))}{_unit(row)}"


def _unit(row: SheetRow) -> str:
    return "" if row.sheet_unit == "1" else f"{_SPACE}{row.sheet_unit}"


def cells(row: SheetRow) -> tuple[str, ...]:
    """A row of the table, in the order of `HEAD`."""
    kept = "" if row.kept is None else "yes" if row.kept else "no"
    return (row.axis, row.title, shown(row), shown_limit(row), kept, row.said)


def headline(sheet: DataSheet) -> tuple[str, str, str]:
    """Tone, word and sentence."""
    told = sum(row.value is not None for row in sheet.rows)
    limits = [row.kept for row in sheet.rows if row.kept is not None]
    kept = f"{sum(limits)} of {len(limits)} limits kept" if limits else "no limit is set ([limits] of the bench file)"
    sentence = f"{told} figures of {sheet.device} in {significant(sheet.seconds)} s of record; {kept}"
    return ("good", "Good", sentence) if sheet.verdict == "good" else ("bad", "Failed", sentence)
