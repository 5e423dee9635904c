"""Figures of a data sheet as text, in its units."""

import math

from hil.bench.data_sheet import BY_NAME
from hil.numbers import significant
from hil.records.data_sheet import DataSheet, SheetRow

HEAD = ("axis", "figure", "value, 95 % interval", "limit", "kept", "remark")
_SPACE = "\u00a0"


def shown(row: SheetRow) -> str:
    """`0.152 °/√h (0.148 to 0.156)`: as many digits as the interval bears."""
    if row.value is None or row.low is None or row.high is None:
        return "not determined"
    figure = BY_NAME[row.figure]
    value, low, high = (figure.shown(number) for number in (row.value, row.low, row.high))
    half, size = 0.5 * (high - low), max(abs(value), abs(low), abs(high))
    digits = 3 if half <= 0.0 or size == 0.0 else min(max(2 - math.floor(math.log10(half / size)), 2), 6)
    text = f"{significant(value, digits)}{_unit(row)}"
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
