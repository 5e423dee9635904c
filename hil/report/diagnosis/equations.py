"""An equation written in a line, as `-k3x*x**3`, set as print sets it."""

import re
from html import escape

_UPRIGHT = {"sin", "cos", "tan", "tanh", "exp", "sign", "sgn", "sqrt", "log", "Abs", "min", "max", "clip"}
_SYMBOLS = {"vx": "ẋ", "vy": "ẏ", "omega": "ω", "Omega": "Ω", "tau": "τ", "zeta": "ζ", "psi": "ψ", "phi": "φ"}
_TOKEN = re.compile(
    r"\*\*\(?(?P<power>-?\w+)\)?|(?P<name>[^\W\d]\w*)|(?P<number>\d+(?:\.\d*)?(?:e[+-]?\d+)?)|(?P<rest>.)"
)
_OPERATORS = {"*": "\u202f", "-": "\u2212", "+": "+", "=": "="}
_SPACED = re.compile(r"\s*([+\u2212=])\s*")


def typeset(equation: str) -> str:
    """HTML of an equation: symbols in italics, indices below, powers above."""
    parts = [_set(match) for match in _TOKEN.finditer(equation)]
    spaced = _SPACED.sub(lambda found: f" {found.group(1)} ", "".join(parts))
    return spaced.replace("  ", " ").strip()


def _set(match: re.Match[str]) -> str:
    if power := match["power"]:
        return f"<sup>{escape(power.replace('-', _OPERATORS['-']))}</sup>"
    if name := match["name"]:
        return _name(name)
    if number := match["number"]:
        return number.rstrip("0").rstrip(".") if "." in number and "e" not in number else number
    return _OPERATORS.get(match["rest"], escape(match["rest"]))


def _name(name: str) -> str:
    if name in _UPRIGHT or (name.isalpha() and name.isascii() and len(name) > 4 and name not in _SYMBOLS):
        return name
    if name in _SYMBOLS:
        return f"<i>{_SYMBOLS[name]}</i>"
    letter, index = name[0], name[1:].lstrip("_")
    return f"<i>{escape(letter)}</i>" + (f"<sub>{escape(index)}</sub>" if index else "")
