"""Numbers as a reader of a measurement report expects them: prefixes, matched digits, thin spaces."""

import math

_PREFIXES = {-15: "f", -12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_PREFIXED = ("V", "rad", "rad/s")
_THIN, _SPACE, _MINUS = "\u202f", "\u00a0", "\u2212"


def prefix_for(size: float, most: int = 9) -> tuple[float, str]:
    """Factor and SI prefix that bring `size` between 1 and 1000; the prefix is 10^`most` at most.

    >>> prefix_for(2e-4)
    (1000000.0, 'µ')
    """
    if not math.isfinite(size) or size == 0:
        return 1.0, ""
    exponent = min(max(3 * math.floor(math.log10(abs(size)) / 3 + 1e-12), -15), most)
    return 10.0**-exponent, _PREFIXES[exponent]


def quantity(value: float, unit: str, digits: int = 3) -> str:
    """A value with an SI prefix before its unit, a no-break space between.

    >>> quantity(2.098e-4, "rad").replace(_SPACE, " ")
    '210 µrad'
    """
    if not math.isfinite(value):
        return significant(value)
    factor, prefix = prefix_for(value, 0 if unit.startswith("rad") else 9)  # nobody counts in krad
    return f"{significant(value * factor, digits)}{_SPACE}{prefix}{unit}".rstrip()


def sensed(value: float, unit: str, digits: int = 3) -> str:
    """What a sense channel shows: volts with a prefix, a sensor's own unit, as px or µstrain, as it is."""
    return quantity(value, unit, digits) if unit in _PREFIXED else f"{significant(value, digits)}{_SPACE}{unit}"


def significant(value: float, digits: int = 3) -> str:
    """Rounded to significant digits; a power of ten where plain digits would be long."""
    if not math.isfinite(value):
        return "not finite"
    if value == 0:
        return f"{value:g}"
    exponent = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    if -4 <= exponent < 7:
        return _typeset(f"{round(value, digits - 1 - exponent):.{max(digits - 1 - exponent, 0)}f}")
    return _power(f"{value / 10.0**exponent:.{digits - 1}f}", exponent)


def plus_minus(value: float, half_width: float, beside: float | None = None) -> str:
    """Value and half width of its interval, the half width with two digits: `1 610 719 ± 31`.

    With `beside`, that number instead, written so that it can be read against such a pair.
    """
    if not (math.isfinite(half_width) and half_width > 0):
        return significant(value if beside is None else beside, 6)
    last = math.floor(math.log10(half_width)) - 1
    exponent = math.floor(math.log10(max(abs(value), half_width)))
    shift = 0 if -3 <= exponent < 7 else exponent
    decimals, scale = max(shift - last, 0), 10.0**-shift
    if beside is not None:
        alone = f"{beside * scale:.{decimals}f}"
        return _power(alone, shift) if shift else _typeset(alone)
    pair = f"{_typeset(f'{value * scale:.{decimals}f}')} ± {_typeset(f'{half_width * scale:.{decimals}f}')}"
    return _power(f"({pair})", shift) if shift else pair


def relative(value: float) -> str:
    """A small dimensionless number in %, or ppm below 0.1 %, with its sign."""
    if not math.isfinite(value):
        return significant(value)
    if abs(value) >= 1e-3:
        return f"{_signed(value * 100)}{_SPACE}%"
    return f"{_signed(value * 1e6)}{_SPACE}ppm"


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
    return _typeset(str(value))


def _signed(value: float) -> str:
    return ("+" if value >= 0 else "") + significant(value)


def _typeset(text: str) -> str:
    sign = _MINUS if text.startswith("-") else "+" if text.startswith("+") else ""
    whole, point, fraction = text.lstrip("+-").partition(".")
    if whole.isdigit() and len(whole) > 4:
        whole = f"{int(whole):,}".replace(",", _THIN)
    return sign + whole + point + fraction


def _power(mantissa: str, exponent: int) -> str:
    return f"{_typeset(mantissa)} × 10{str(exponent).translate(_SUPERSCRIPT)}"
