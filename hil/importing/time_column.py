"""Columns of time of every kind as seconds: numbers, whole numbers of any size, dates, lengths of time, ISO 8601 text.

What is counted in whole numbers is subtracted before it becomes a float, which has not the digits for all
nanoseconds since 1970.
"""

from collections.abc import Sequence
from decimal import Decimal, InvalidOperation
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from hil.importing.units import UNITS

Floats = npt.NDArray[np.float64]
OWN_UNIT = "iso"
_LONGEST_DIGITS = 12
_SOME = 1000
_SECONDS = {"D": 86400.0, "h": 3600.0, "m": 60.0, "s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "W": 604800.0}


class Stamps(NamedTuple):
    """elapsed (n,): seconds since the first row, NaN where the time is missing; start: the first row's time, None where
    it is a date; digit: what the stamps are rounded to, in seconds, 0 where that is nothing; given: the time as it
    stands, where that was a float; date: that of the first row, as ISO 8601."""

    elapsed: Floats
    start: float | None
    digit: float
    given: Floats | None = None
    date: str | None = None

    def plus(self, other: "Stamps") -> "Stamps":
        start = None if self.start is None or other.start is None else self.start + other.start
        moving = [one.digit for one in (self, other) if one.elapsed.any()]
        return Stamps(self.elapsed + other.elapsed, start, min(moving, default=0.0))

    def seconds(self) -> Floats:
        """As time of a record: from the first row on where it is a date, or where a float could not tell the steps."""
        whole = self._whole()
        return self.elapsed if whole is None else whole

    def moved_from(self) -> str | None:
        """The first row's time where the record's starts at 0 instead; None where it stays."""
        if self._whole() is not None or (self.start == 0.0 and self.date is None):
            return None
        return self.date if self.start is None else f"{self.start:.15g} s"

    def _whole(self) -> Floats | None:
        if self.start is None or not np.isfinite(self.start):
            return None
        whole = self.start + self.elapsed if self.given is None else self.given
        usual = float(np.nanmedian(np.abs(np.diff(self.elapsed)))) if self.elapsed.size > 1 else 1.0
        return whole if float(np.spacing(np.nanmax(np.abs(whole)))) < 1e-6 * usual else None


def stamps_of(values: npt.NDArray[Any], unit: str | None, scale: float = 1.0, offset: float = 0.0) -> Stamps:
    """A column (n,) in `unit`; None: numbers are seconds, whatever else says its own.

    Raises ValueError for a kind and a unit that do not go together, and for texts that are no times.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # the caller refuses what is not finite, with its row
        return _stamps(_typed(values) if values.dtype == object else values, unit, scale, offset)


def _stamps(values: npt.NDArray[Any], unit: str | None, scale: float, offset: float) -> Stamps:
    kind = values.dtype.kind
    if kind in "mM":
        if unit not in (None, OWN_UNIT):
            raise ValueError(f'unit: the column holds dates or lengths of time, not {unit}; set unit = "{OWN_UNIT}"')
        return _dated(values, scale, offset)
    if unit == OWN_UNIT:
        raise ValueError('unit: the column holds numbers, no dates; set unit = "s", "ms", "us" or "ns"')
    factor = UNITS["s"][unit or "s"][0] * scale
    addition = UNITS["s"][unit or "s"][0] * offset
    if kind in "iu":
        elapsed, digit = _whole(values), _digit_of_whole(values)
        return Stamps(elapsed * factor, float(values[0]) * factor + addition, abs(digit * factor))
    if kind == "O":  # exact decimals
        exact = [Decimal(text) if text else None for text in values]
        first = next((one for one in exact if one is not None), Decimal(0))
        elapsed = np.array([np.nan if one is None else float(one - first) for one in exact])
        digit = 10.0 ** max((int(one.as_tuple().exponent) for one in exact if one is not None), default=0)
        if all(one is None or one == int(one) for one in exact):
            digit = _digit_of_whole(np.array([int(one - first) for one in exact if one is not None], dtype=object))
        return Stamps(elapsed * factor, float(first) * factor + addition, abs(max(digit, 0.0) * factor))
    floats = values.astype(float)
    first_finite = floats[np.isfinite(floats)][:1]
    start = float(first_finite[0]) if first_finite.size else 0.0
    digit = _digit_of_floats(floats[np.isfinite(floats)], values.dtype.itemsize < 8)
    given = floats * factor + addition
    return Stamps((floats - start) * factor, start * factor + addition, abs(digit * factor), given)


def _typed(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Objects as dates or lengths of time; texts of numbers stay as they are, to be read exactly."""
    import pyarrow as pa

    given = [None if value is None or value == "" else value for value in values]
    if not any(isinstance(one, str) for one in given):
        try:
            made = pa.array(given)
        except (pa.ArrowException, TypeError, ValueError):
            raise ValueError("no time: neither numbers nor dates") from None
        return of_arrow(made)
    first = next(one for one in given if one is not None)
    if _is_number(first):
        bad = next((one for one in given if one is not None and not _is_number(one)), None)
        if bad is not None:
            raise ValueError(f"{bad!r} is not a number")
        return values
    texts = pa.array([None if one is None else str(one).strip().replace(",", ".") for one in given])
    for kind in (pa.timestamp("ns"), pa.timestamp("ns", tz="UTC")):
        try:
            return of_arrow(texts.cast(kind))
        except pa.ArrowException:
            continue
    try:  # times of a day
        days = pa.array([None if one is None else f"1970-01-01T{one}" for one in texts.to_pylist()])
        return of_arrow(days.cast(pa.timestamp("ns"))) - np.datetime64(0, "ns")
    except pa.ArrowException:
        pass
    raise ValueError(
        f"{str(first)[:40]!r} or one below it is no time of ISO 8601, as 2026-01-31T12:00:00.5, "
        "or they are not all of one kind; write them so, or seconds"
    )


def of_arrow(column: Any) -> npt.NDArray[Any]:
    """A column of pyarrow that is a date or a length of time as NumPy has it."""
    import pyarrow as pa

    kind = column.type
    if pa.types.is_time(kind):
        unit = kind.unit
        whole = column.cast(pa.int32() if pa.types.is_time32(kind) else pa.int64()).cast(pa.int64())
        column = whole.cast(pa.duration(unit))
    elif pa.types.is_date(kind):
        column = column.cast(pa.timestamp("ms"))
    elif pa.types.is_timestamp(kind) and kind.tz is not None:
        column = column.cast(pa.timestamp(kind.unit))
    elif not (pa.types.is_timestamp(kind) or pa.types.is_duration(kind)):
        raise ValueError(f"no time, but {kind}")
    return np.asarray(column.to_numpy(zero_copy_only=False))


def _dated(values: npt.NDArray[Any], scale: float, offset: float) -> Stamps:
    unit, count = np.datetime_data(values.dtype)
    one = count * _SECONDS.get(unit, 1.0)
    missing = np.isnat(values)
    counts = values.astype(np.int64)
    first = int(counts[~missing][0]) if (~missing).any() else 0
    elapsed = (counts - first).astype(float) * one
    elapsed[missing] = np.nan
    start = None if values.dtype.kind == "M" else first * one * scale + offset
    digit = _digit_of_whole(counts[~missing]) * one * abs(scale)
    date = str(values[~missing][0]) if start is None and (~missing).any() else None
    return Stamps(elapsed * scale, start, digit, date=date)


def _whole(values: npt.NDArray[Any]) -> Floats:
    """Differences to the first of whole numbers, exactly before they become floats."""
    if values.dtype.kind == "u" and values.size and int(values.max()) > np.iinfo(np.int64).max:
        first = int(values[0])
        return np.array([int(value) - first for value in values], dtype=float)
    counts = values.astype(np.int64)
    return np.asarray((counts - counts[0]).astype(float))


def _digit_of_whole(values: npt.NDArray[Any]) -> float:
    """The power of ten that all differences of whole numbers are multiples of."""
    if values.dtype == object:
        values = np.array([int(value) for value in values], dtype=np.int64)
    common = int(np.gcd.reduce(np.diff(values.astype(np.int64)))) if values.size > 1 else 0
    digit = 1
    while common and common % (10 * digit) == 0:
        digit *= 10
    return float(digit)


def _digit_of_floats(values: Floats, single: bool) -> float:
    """What floats are rounded to: decimals, significant digits, or single precision."""
    if not values.size:
        return 0.0
    largest = float(np.max(np.abs(values)))
    if largest == 0.0:
        return 0.0
    found = [0.0]
    if largest < 2**53 and np.array_equal(values, np.round(values)):
        return _digit_of_whole(values.astype(np.int64))
    if single or np.array_equal(values, values.astype(np.float32).astype(float)):
        found.append(2.0 * float(np.spacing(np.float32(largest))))  # often rounded more than once
    for decimals in range(1, _LONGEST_DIGITS + 1):
        if _are_rounded(values, 10.0**decimals, largest):
            found.append(10.0**-decimals)
            break
    usual = float(np.quantile(np.abs(values), 0.9))  # the first value of a longer number says nothing of its digits
    leading = int(np.floor(np.log10(usual or largest)))
    for digits in range(3, 10):
        if _have_digits(values, digits):
            found.append(10.0 ** (leading - digits + 1))
            break
    return max(found)


def _are_rounded(values: Floats, per_unit: float, largest: float) -> bool:
    if largest * per_unit * 2.0**-51 > 1e-2:
        return False
    for some in (values[:_SOME], values):
        scaled = some * per_unit
        if not np.all(np.abs(scaled - np.round(scaled)) <= 2.0**-50 * np.abs(scaled) + 1e-12):
            return False
    return True


def _have_digits(values: Floats, digits: int) -> bool:
    for some in (values[:_SOME], values):
        used = some[some != 0.0]
        power = 10.0 ** (digits - 1 - np.floor(np.log10(np.abs(used))))
        if not np.all(np.abs(used * power - np.round(used * power)) <= 2.0**-48 * np.abs(used * power)):
            return False
    return True


def _is_number(text: object) -> bool:
    try:
        return Decimal(str(text)).is_finite()
    except InvalidOperation:
        return False


def sum_of(columns: Sequence[Stamps]) -> Stamps:
    """The time that stands in several columns."""
    whole = columns[0]
    for one in columns[1:]:
        whole = whole.plus(one)
    return whole
