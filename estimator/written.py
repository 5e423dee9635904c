"""Numbers in sentences and tables: matched digits, powers of ten, thin spaces."""

import math

_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_THIN, _MINUS = "\u202f", "\u2212"


def significant(value: float, digits: int = 3) -> str:
    """Rounded to significant digits; a power of ten where plain digits would be long."""
    if not math.isfinite(value):
        return "not finite"
    if value == 0:
        return f"{value:g}"
    exponent = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    if -4 <= exponent < 7:
        return typeset(f"{round(value, digits - 1 - exponent):.{max(digits - 1 - exponent, 0)}f}")
    return _power(f"{value / 10.0**exponent:.{digits - 1}f}", exponent)


def gains(value: float) -> str:
    """By how much one effect more raises twice the log-likelihood, in words."""
    return f"raises 2 ln L by {significant(value)}"


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
        return _power(alone, shift) if shift else typeset(alone)
    pair = f"{typeset(f'{value * scale:.{decimals}f}')} ± {typeset(f'{half_width * scale:.{decimals}f}')}"
    return _power(f"({pair})", shift) if shift else pair


def typeset(text: str) -> str:
    """Plain digits with a minus that is one, none before a zero, and in groups of three where there are more than four.

    >>> typeset("-0.13"), typeset("-0.0")
    ('−0.13', '0.0')
    """
    negative = text.startswith("-") and text.strip("-0.") != ""
    sign = _MINUS if negative else "+" if text.startswith("+") else ""
    whole, point, fraction = text.lstrip("+-").partition(".")
    if whole.isdigit() and len(whole) > 4:
        whole = f"{int(whole):,}".replace(",", _THIN)
    return sign + whole + point + fraction


def power_of_ten(exponent: int) -> str:
    """10 with the exponent raised.

    >>> power_of_ten(-6)
    '10⁻⁶'
    """
    return f"10{str(exponent).translate(_SUPERSCRIPT)}"


def _power(mantissa: str, exponent: int) -> str:
    return f"{typeset(mantissa)} × {power_of_ten(exponent)}"
