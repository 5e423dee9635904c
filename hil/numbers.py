"""Numbers as a reader of a measurement report expects them: prefixes, matched digits, thin spaces.

Pages, terminal and verdicts write theirs here, so that one number looks the same wherever it stands.
"""

import math
from collections.abc import Iterable

from estimator.written import plus_minus as plus_minus
from estimator.written import power_of_ten
from estimator.written import significant as significant
from estimator.written import typeset as typeset

_PREFIXES = {-15: "f", -12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
PREFIXED = ("V", "rad", "rad/s")
"""Units that take a prefix."""
_SPACE = "\u00a0"


def finite(value: float | None) -> float | None:
    """The number as JSON has it: None where it is not finite."""
    return float(value) if value is not None and math.isfinite(value) else None


def prefix_for(size: float, most: int = 9) -> tuple[float, str]:
    """Factor and SI prefix that bring `size` between 1 and 1000; the prefix is 10^`most` at most.

    >>> prefix_for(2e-4)
    (1000000.0, 'µ')
    """
    if not math.isfinite(size) or size == 0:
        return 1.0, ""
    exponent = min(max(3 * math.floor(math.log10(abs(size)) / 3 + 1e-12), -15), most)
    return 10.0**-exponent, _PREFIXES[exponent]


def in_thousands(value: float) -> tuple[float, str]:
    """Factor that takes a long number to between 1 and 1000, and the power of ten that then stands before its unit.

    >>> in_thousands(1e13), in_thousands(0.2)
    ((1e-12, '10¹² '), (1.0, ''))
    """
    if not math.isfinite(value) or value == 0 or 1e-3 <= abs(value) < 1e7:
        return 1.0, ""
    exponent = 3 * math.floor(math.log10(abs(value)) / 3 + 1e-12)
    return 10.0**-exponent, f"{power_of_ten(exponent)} "


def unit_for(size: float, unit: str) -> tuple[float, str]:
    """Factor and unit in which a number of that size is short: the unit with a prefix, or after a power of ten.

    >>> unit_for(-8.5e-3, "V"), unit_for(1e13, "1/(m²·s²)"), unit_for(0.2, "1/s")
    ((1000.0, 'mV'), (1e-12, '10¹² 1/(m²·s²)'), (1.0, '1/s'))
    """
    factor, prefix = prefix_for(size, most=0) if unit in PREFIXED else in_thousands(size)
    return factor, (prefix + unit).strip()


def quantity(value: float, unit: str, digits: int = 3) -> str:
    """A value with an SI prefix before its unit, a no-break space between.

    >>> quantity(2.098e-4, "rad").replace(_SPACE, " ")
    '210 µrad'
    """
    if not math.isfinite(value):
        return significant(value)
    factor, prefix = prefix_for(value, 0 if unit.startswith("rad") else 9)  # nobody counts in krad
    return f"{significant(value * factor, digits)}{_SPACE}{prefix}{unit}".rstrip()


def beside_degrees(text: str, value: float, unit: str, digits: int = 3) -> str:
    """`text`, which tells `value` in rad or rad/s, with the same in degrees or °/s behind it; of other units as it is.

    >>> beside_degrees("1.50 mrad", 1.5e-3, "rad"), beside_degrees("3.0 V", 3.0, "V")
    ('1.50 mrad (0.0859°)', '3.0 V')
    """
    symbol = {"rad": "°", "rad/s": f"{_SPACE}°/s"}.get(unit)
    return (
        text
        if symbol is None or not math.isfinite(value)
        else f"{text} ({significant(math.degrees(value), digits)}{symbol})"
    )


def in_both(value: float, unit: str, digits: int = 3) -> str:
    """As `quantity`, an angle or a rate in degrees or °/s too."""
    return beside_degrees(quantity(value, unit, digits), value, unit, digits)


def sensed(value: float, unit: str, digits: int = 3) -> str:
    """What a sense channel shows: volts with a prefix, a sensor's own unit, as px or µstrain, as it is."""
    return quantity(value, unit, digits) if unit in PREFIXED else f"{significant(value, digits)}{_SPACE}{unit}"


def relative(value: float) -> str:
    """A small dimensionless difference in %, or ppm below 0.1 %, with its sign."""
    factor, unit = _in_parts(value)
    return f"{signed(value * factor)}{_SPACE}{unit}" if math.isfinite(value) else significant(value)


def magnitude(value: float) -> str:
    """A small dimensionless size, as a standard uncertainty, in the same units and without a sign.

    >>> magnitude(1e-3).replace(_SPACE, " ")
    '0.100 %'
    """
    factor, unit = _in_parts(value)
    return f"{significant(abs(value) * factor)}{_SPACE}{unit}" if math.isfinite(value) else significant(value)


def percent(fraction: float, decimals: int = 1) -> str:
    """A fraction in percent.

    >>> percent(0.951).replace(_SPACE, " ")
    '95.1 %'
    """
    return f"{fraction * 100:.{decimals}f}{_SPACE}%"


def share(part: int, whole: int) -> str:
    """A count and, when there is something, its share of the whole: `12 (0.15 %)`."""
    if not part or not whole:
        return count(part)
    fraction = part / whole
    size = percent(fraction, 2) if fraction >= 1e-3 else f"{fraction * 1e6:.0f}{_SPACE}ppm"
    return f"{count(part)} ({size})"


def count(value: int) -> str:
    """Whole number in groups of three."""
    return typeset(str(value))


def counted(value: int, what: str) -> str:
    """A whole number of things, of which one is called `what`.

    >>> counted(1, "sample"), counted(2, "sample")
    ('1 sample', '2 samples')
    """
    return f"{count(value)} {what}{'' if value == 1 else 's'}"


def times(value: int) -> str:
    """How often.

    >>> times(1), times(3)
    ('once', '3 times')
    """
    return "once" if value == 1 else f"{count(value)} times"


def together(values: Iterable[float], unit: str, digits: int = 3) -> list[str]:
    """Quantities of a column, all with the prefix of the largest, so that they can be read against each other.

    >>> [text.replace(_SPACE, " ") for text in together([0.0283, 2e-4], "rad")]
    ['28.3 mrad', '0.200 mrad']
    """
    values = list(values)
    finite = [abs(value) for value in values if math.isfinite(value)]
    factor, prefix = prefix_for(max(finite, default=0.0), 0 if unit.startswith("rad") else 9)
    return [f"{significant(value * factor, digits)}{_SPACE}{prefix}{unit}".rstrip() for value in values]


def signed(value: float, digits: int = 3) -> str:
    """Significant digits, with a sign that is told of what is positive, too."""
    return ("+" if value >= 0 else "") + significant(value, digits)


def _in_parts(value: float) -> tuple[float, str]:
    """Factor and unit of a dimensionless number: %, or ppm below 0.1 %."""
    return (1e2, "%") if abs(value) >= 1e-3 else (1e6, "ppm")


def with_and(names: Iterable[str]) -> str:
    """`a, b and c`."""
    *others, last = names
    return f"{', '.join(others)} and {last}" if others else last


COVERAGE = 2.0
"""Factor k of the expanded uncertainty U = k u: about 95 % for what is nearly normal."""

SD_95 = 1.959964
"""Half width of a 95 % interval in standard deviations of a normal variable."""
