"""The time of a record: stamps of one column or several, the samples that they number, what is missing between them."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil.errors import InputError
from hil.importing.mapping import FASTEST_HZ, SLOWEST_HZ, RecordMap
from hil.importing.naming import Asked
from hil.importing.source import Source, Table
from hil.importing.time_column import Stamps, stamps_of, sum_of
from hil.importing.uniformity import Numbered, first_not_increasing, numbered, odd_step, spacing

_FEW = 0.1
"""Of the rows: more that repeat a stamp are no rows written twice."""


_COARSE = 0.01
"""Of a step: rounding beyond it is told, as in `uniformity`."""


_BEYOND_DATES_S = 2.6e11
"""From 1970 on: the end of the year 9999, roughly."""


class Remedies(NamedTuple):
    """What a refusal advises: how uneven time is accepted, how gaps are kept, where a rate is stated."""

    uneven: str = "give --nonuniform if the record is meant so"
    gaps: str = "give --nonuniform to keep them as gaps"
    rate: str = "in the map, beside t_s"
    sort: str = "sort or mend the time column"
    column: str = ""
    apart: str = "import what lies before and behind by itself"
    one_row: str = "one row only; a record needs at least two"


def time_of(source: Source, asked: Asked, table: Table, *, may_be_missing: bool) -> Stamps | None:
    """The time of each row, NaN where it is missing and may be; None where the record has no column of it."""
    columns = []
    for part, values in zip(asked.parts, table.columns, strict=True):
        if part.is_time:
            if values.size == 0:
                return None
            try:
                stamps = stamps_of(values, part.unit, part.scale, part.offset)
            except ValueError as error:
                key = "" if part.unit is None else "[columns.t_s] "
                raise InputError(f"{source.called}: column {part.called}: {key}{error}") from None
            columns.append(stamps)
            bad = np.flatnonzero(~np.isfinite(stamps.elapsed))
            if bad.size and values.dtype.kind in "fiu" and (broken := bad[np.isfinite(values[bad])]).size:
                place = source.place(int(table.rows[broken[0]]), part.called)
                raise InputError(f"{place}: no finite number in {part.unit}; correct scale, offset or unit")
            if bad.size and not may_be_missing:
                row = int(bad[0])
                raise InputError(
                    f"{source.place(int(table.rows[row]), part.called)}: nan is no measurement; leave the row out"
                )
    return sum_of(columns) if columns else None


def numbered_rows(
    source: Source,
    mapping: RecordMap,
    table: Table,
    stamps: Stamps | None,
    measured: npt.NDArray[np.bool_],
    nonuniform: bool,
    remedies: Remedies,
    said: list[str],
) -> tuple[Numbered, npt.NDArray[np.float64]]:
    """The number of each row that was measured, and its time; what is to be told of it goes into `said`.  Raises
    InputError with row and remedy.
    """
    if table.rows.size < 2:
        raise InputError(f"{source.called}: {remedies.one_row}")
    rows = np.flatnonzero(measured)
    rate = 1.0 if mapping.steady else mapping.sampling_rate_Hz
    if stamps is None or mapping.steady:
        assert rate is not None  # or the columns would have been refused
        tick = np.arange(rows.size) if mapping.steady else rows - rows[0]
        return Numbered(tick, rate, True), (tick + (0 if mapping.steady else rows[0])) / rate
    if rate is not None:
        return _stated(source, table, stamps, rows, rate)
    if abs(stamps.start or 0.0) > _BEYOND_DATES_S:
        raise InputError(
            f"{source.called}: column t_s: begins at {stamps.start:.4g} s, later than any date; say in the map which "
            'unit it has: "ns", "us" or "ms"'
        )
    stamped = np.flatnonzero(np.isfinite(stamps.elapsed))  # rows that are lost have a time as a rule
    time, rounded = _evenly(source, table, stamps, stamped, nonuniform, remedies, said)
    if not SLOWEST_HZ <= time.rate_Hz <= FASTEST_HZ:
        raise InputError(
            f"{source.called}: column t_s: {time.rate_Hz:.3g} Hz, beyond {SLOWEST_HZ:g} to {FASTEST_HZ:g} Hz; "
            "check the unit of t_s"
        )
    tick = time.tick[np.isin(stamped, rows)]
    seconds = stamps.seconds()[rows]
    tick -= tick[0]
    return Numbered(tick, time.rate_Hz, time.uniform), seconds[0] + tick / time.rate_Hz if rounded else seconds


def _evenly(
    source: Source,
    table: Table,
    stamps: Stamps,
    rows: npt.NDArray[np.int64],
    nonuniform: bool,
    remedies: Remedies,
    said: list[str],
) -> tuple[Numbered, bool]:
    """The numbers of rows with stamps that are even, or accepted as they are, and whether they are even but for their
    rounding; `said` has what is to be told of them.
    """
    elapsed, seconds = stamps.elapsed[rows], stamps.seconds()[rows]
    fallen = first_not_increasing(elapsed)
    coarse = None if fallen is None else rounded_grid(elapsed, stamps.digit)
    if fallen is not None and coarse is None:
        place = source.place(int(table.rows[rows[fallen]]), "t_s")
        later, earlier = seconds[fallen], seconds[fallen - 1]
        if later == earlier:
            raise InputError(f"{place}: {_repeated(elapsed, float(later), remedies)}")
        raise InputError(f"{place}: {later:.9g} s is not later than {earlier:.9g} s on the row before; {remedies.sort}")
    off = spacing(elapsed).first_off_grid if fallen is None else fallen
    if off is None:
        return numbered(elapsed), False
    time = numbered(elapsed) if fallen is None else None
    place = source.place(int(table.rows[rows[off]]), "t_s")
    if time is None or not time.uniform:
        coarse = coarse or rounded_grid(elapsed, stamps.digit)
        if coarse is not None:
            fits = f"stamps are rounded to {stamps.digit:.3g} s, and {coarse.rate_Hz:.9g} Hz fits them all"
            if not nonuniform:
                raise InputError(f"{place}: {fits}; set sampling_rate_Hz = {coarse.rate_Hz:.9g} {remedies.rate}")
            said.append(f"taken as even: {fits}")
            time = Numbered(coarse.tick, coarse.rate_Hz, True)
    assert time is not None
    told = rows.size < stamps.elapsed.size and time.uniform  # the map says which stamps are missing
    share = stamps.digit * time.rate_Hz
    if not time.uniform and share > _COARSE:
        said.append(f"stamps are rounded to {stamps.digit:.3g} s, {share:.0%} of a step: no interval accounts for that")
    if not nonuniform and not told:
        remedy = f"{time.missing()}; {remedies.gaps}" if time.lost else remedies.uneven
        raise InputError(f"{place}: {odd_step(elapsed, off)}; {remedy}")
    if time.mostly_lost:
        column = remedies.column or f"{source.called}: column t_s"
        raise InputError(f"{column}: {time.missing()}, more than there are; {remedies.apart}")
    return time, coarse is not None and time.uniform


def _repeated(elapsed: npt.NDArray[np.float64], stamp: float, remedies: Remedies) -> str:
    """What is to be told of a stamp that is that of the row before as well."""
    count = int(np.count_nonzero(np.diff(elapsed) == 0.0))
    told = f"{stamp:.9g} s is the stamp of the row before as well"
    if count > max(_FEW * elapsed.size, 1.0):
        return f"{told}, {count} rows in all repeat one; leave out t_s and set sampling_rate_Hz, or give a finer time"
    others = f", and so in {count - 1} more" if count > 1 else ""
    return f"{told}{others}; remove the row, or the one that it repeats"


def _stated(
    source: Source, table: Table, stamps: Stamps, rows: npt.NDArray[np.int64], rate: float
) -> tuple[Numbered, npt.NDArray[np.float64]]:
    elapsed = stamps.elapsed[rows]
    grid = stated_grid(elapsed, rate, stamps.digit)
    if not isinstance(grid, Grid):
        place = source.place(int(table.rows[rows[grid]]), "t_s")
        usual = (rows.size - 1) / (elapsed[-1] - elapsed[0]) if elapsed[-1] > elapsed[0] else 0.0
        raise InputError(
            f"{place}: the stamp is no sample of sampling_rate_Hz = {rate:g}; on average there are {usual:.6g} a "
            "second: correct the rate, mend the row, or leave out one of the two"
        )
    time = Numbered(grid.tick, rate, True)
    if time.mostly_lost:
        raise InputError(
            f"{source.called}: {time.missing()}, more than there are; correct sampling_rate_Hz or the rows"
        )
    start = stamps.seconds()[rows[0]]
    return time, start + grid.tick / rate


Floats = npt.NDArray[np.float64]
_FEWEST = 10
"""Rows from which a rate is told: rounding fits nearly any three."""
_HALVINGS = 60
_REPEATS = 3
"""Stamps twice in a row from which a rate above their resolution is told: one or two are rows written twice."""
_JITTER = 0.1
"""Of a step: what stamps of a stated rate may be off beside their rounding."""

_USUAL = 0.8
"""Of all steps, so many at least are of one sample where stamps are off by all of their rounding."""


class Grid(NamedTuple):
    """Samples per second, and the number of each row (n,)."""

    rate_Hz: float
    tick: npt.NDArray[np.int64]


def rounded_grid(elapsed: Floats, digit: float) -> Grid | None:
    """The grid from which all stamps differ by the rounding to `digit` seconds alone; None where there is none.

    elapsed (n,): seconds, not falling.  Of the rates that fit, one of few digits is preferred.
    """
    if elapsed.size < _FEWEST or digit <= 0.0:
        return None
    steps = np.diff(elapsed)
    if np.any(steps < 0.0):
        return None
    usual = float(np.median(steps))
    near = steps[np.abs(steps - usual) <= 1.5 * digit]
    step = float(np.mean(near))
    if step <= 0.0:
        return None
    repeats = int(np.count_nonzero(steps == 0.0))
    if 0 < repeats < _REPEATS:
        return None
    found = _fitted(elapsed, np.arange(elapsed.size, dtype=float), digit)
    if repeats:  # only of more than one sample to a stamp
        return found if found is not None and found.rate_Hz * digit > 1.0 + 1e-9 else None
    if found is None:
        counts = np.maximum(np.round(steps / step), 1.0)
        found = _fitted(elapsed, np.concatenate([[0.0], np.cumsum(counts)]), digit)
    return found


def _fitted(elapsed: Floats, tick: Floats, digit: float) -> Grid | None:
    """The rate at which rows of these numbers have these stamps, rounded; None where none has."""
    # the range of the residual is convex in the step
    low, high = (elapsed[-1] + sign * 2.0 * digit for sign in (-1.0, 1.0))
    low, high = low / tick[-1], high / tick[-1]
    for _ in range(_HALVINGS):
        third = (high - low) / 3.0
        if np.ptp(elapsed - (low + third) * tick) <= np.ptp(elapsed - (high - third) * tick):
            high -= third
        else:
            low += third
    best = 0.5 * (low + high)
    allowed = digit * (1.0 + 1e-6)
    for digits in range(1, 8):
        rate = float(f"{1.0 / best:.{digits}g}")
        if np.ptp(elapsed - tick / rate) < allowed:
            return Grid(rate, tick.astype(np.int64))
    return Grid(1.0 / best, tick.astype(np.int64)) if np.ptp(elapsed - best * tick) < allowed else None


def stated_grid(elapsed: Floats, rate_Hz: float, digit: float) -> Grid | int:
    """The grid of a stated rate, from which stamps differ by their rounding to `digit` seconds and a tenth of a step;
    the first row that differs by more, or stands where the one before does, where one does.

    The stamps number the rows where they tell samples apart; coarser ones follow one another without a gap.
    """
    samples = elapsed * rate_Hz
    rounding = digit * rate_Hz
    by_stamp = np.round(samples - _phase(samples))
    by_stamp -= by_stamp[0]
    repeated = np.concatenate([[False], np.diff(by_stamp) < 1.0])
    apart = rounding <= 1.0 + 1e-9
    if apart and not repeated.any():
        spread, usual = float(np.ptp(samples - by_stamp)), np.mean(np.diff(by_stamp) == 1.0) >= _USUAL
        if spread < rounding - 1e-9 or (usual and spread <= min(rounding + _JITTER, 1.0 - 1e-9)):
            return Grid(rate_Hz, by_stamp.astype(np.int64))
    off = samples - np.arange(elapsed.size)
    again = np.concatenate([[False], np.diff(elapsed) <= 0.0]) & apart
    if np.ptp(off) <= rounding + _JITTER and not again.any():
        return Grid(rate_Hz, np.arange(elapsed.size, dtype=np.int64))
    if again.any():
        return int(np.argmax(again))
    off = samples - by_stamp
    allowed = min(rounding, 1.0 - 2.0 * _JITTER) + _JITTER
    wrong = repeated | (np.maximum.accumulate(off) - np.minimum.accumulate(off) > allowed)
    return int(np.argmax(wrong))


def _phase(samples: Floats) -> float:
    """Where between whole numbers the samples lie: opposite to the widest stretch of a step in which none does."""
    parts = np.sort(samples % 1.0)
    widths = np.diff(np.concatenate([parts, parts[:1] + 1.0]))
    widest = int(np.argmax(widths))
    return float(parts[widest] + 0.5 * widths[widest] + 0.5) % 1.0
