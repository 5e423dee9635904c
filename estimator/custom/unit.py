"""Units of laws and their coefficients: powers of metre, second, kelvin and volt, per unit mass."""

import re
from dataclasses import dataclass
from fractions import Fraction

from estimator.errors import ModelError

_BASE = ("m", "s", "K", "V")
_LONGEST, _LARGEST = 60, 40
_SUPERSCRIPTS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")
_RAISED = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
_TOKEN = re.compile(
    r"\s*(?:(?P<unit>m|s|K|V|rad|Hz|1)(?:(?:\^|\*\*)?(?P<power>-?[0-9]{1,3}))?(?![A-Za-z0-9])|(?P<sign>[/()*]))"
)
_EXPECTED = "units are m, s, K, V, rad and 1, as in 1/(m⁴·s²) or 1/(m^4 s^2)"


@dataclass(frozen=True)
class Unit:
    """Powers of metre, second, kelvin and volt."""

    powers: tuple[Fraction, Fraction, Fraction, Fraction] = (Fraction(0),) * 4

    def __mul__(self, other: "Unit") -> "Unit":
        m, s, k, v = (a + b for a, b in zip(self.powers, other.powers, strict=True))
        return Unit((m, s, k, v))

    def __pow__(self, exponent: Fraction | int) -> "Unit":
        m, s, k, v = (a * exponent for a in self.powers)
        return Unit((m, s, k, v))

    def __truediv__(self, other: "Unit") -> "Unit":
        return self * other**-1

    @property
    def whole(self) -> bool:
        """Whether all its powers are whole numbers, as a coefficient's must be."""
        return all(power.denominator == 1 for power in self.powers)

    def __str__(self) -> str:
        named = [(name, power) for name, power in zip(_BASE, self.powers, strict=True) if power]
        above = "·".join(name + _raised(power) for name, power in named if power > 0)
        below = "·".join(name + _raised(-power) for name, power in named if power < 0)
        return (above or "1") + (f"/({below})" if "·" in below else f"/{below}" if below else "")


def _of(m: int = 0, s: int = 0, k: int = 0, v: int = 0) -> Unit:
    return Unit((Fraction(m), Fraction(s), Fraction(k), Fraction(v)))


NUMBER, METRE, SECOND, KELVIN, VOLT = _of(), _of(m=1), _of(s=1), _of(k=1), _of(v=1)
SPEED, FORCE, PER_SECOND = _of(m=1, s=-1), _of(m=1, s=-2), _of(s=-1)
_NAMED = {"m": METRE, "s": SECOND, "K": KELVIN, "V": VOLT, "rad": NUMBER, "1": NUMBER, "Hz": PER_SECOND}


def unit_of(text: str) -> Unit:
    """The unit that a text such as `1/(m⁴·s²)` names.

    Raises ModelError, one line, for any other text.
    """
    if len(text) > _LONGEST:
        raise ModelError(f"a unit of {len(text)} characters; {_EXPECTED}")
    plain = re.sub(r"[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+", lambda found: "^" + found[0].translate(_SUPERSCRIPTS), text)
    tokens = _tokens(plain.replace("·", "*").replace("**", "^"), text)
    unit, rest = _product(tokens, text, within=False)
    if rest or any(abs(power) > _LARGEST for power in unit.powers):
        raise _wrong(text)
    return unit


def _tokens(plain: str, text: str) -> list[Unit | str]:
    tokens: list[Unit | str] = []
    at = 0
    while plain[at:].strip():
        found = _TOKEN.match(plain, at)
        if found is None:
            raise _wrong(text)
        sign = found["sign"]
        tokens.append(sign if sign else _NAMED[found["unit"]] ** int(found["power"] or 1))
        at = found.end()
    return tokens


def _product(tokens: list[Unit | str], text: str, *, within: bool) -> tuple[Unit, list[Unit | str]]:
    """Unit of the tokens up to the end or a closing parenthesis, and what is behind it."""
    unit, below, begun = NUMBER, False, False
    while tokens:
        token, *tokens = tokens
        if token == ")":
            if not within or not begun:
                raise _wrong(text)
            return unit, tokens
        if token == "*":
            if not begun or not tokens or tokens[0] in ("*", "/", ")"):
                raise _wrong(text)
            continue
        if token == "/":
            if below or not begun:
                raise _wrong(text)
            below, begun = True, False
            continue
        if below and begun:
            raise ModelError(f"unit {text!r}: put what is below the line in parentheses, as in 1/(m⁴·s²)")
        if token == "(":
            factor, tokens = _product(tokens, text, within=True)
        elif isinstance(token, Unit):
            factor = token
        else:
            raise _wrong(text)
        unit = unit / factor if below else unit * factor
        begun = True
    if within or not begun:
        raise _wrong(text)
    return unit, []


def _wrong(text: str) -> ModelError:
    shown = text if text.isprintable() else ascii(text)[1:-1]
    return ModelError(f"unit '{shown}' is none; {_EXPECTED}")


def _raised(power: Fraction) -> str:
    if power == 1:
        return ""
    return str(power.numerator).translate(_RAISED) if power.denominator == 1 else f"^{float(power):g}"
