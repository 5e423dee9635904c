"""An equation written in a line, as `-k3x*x**3`, set as print sets it."""

import re
import unicodedata
from html import escape

_UPRIGHT = {"exp", "max"}  # functions that would be read as a letter with its axis
_LONGEST_INDEX = 3
_SYMBOLS = {"vx": "ẋ", "vy": "ẏ", "omega": "ω", "Omega": "Ω", "tau": "τ", "zeta": "ζ", "psi": "ψ", "phi": "φ"}
_TOKEN = re.compile(
    r"\*\*(?:\((?P<inner>[-\w./]+)\)|(?P<power>-?\w+(?:\.\d+)?))|(?P<name>[^\W\d²³¹⁰⁴-⁹][^\W²³¹⁰⁴-⁹]*)|(?P<number>\d+(?:\.\d*)?(?:e[+-]?\d+)?)|(?P<rest>.)"
)
_OPERATORS = {"*": "\u202f", "-": "\u2212", "+": "+", "=": "="}
_POWER = re.compile(r"\*\*(?:\((-?[\d./]+)\)|(-?\d+(?:\.\d+)?))")
_RAISED = str.maketrans("0123456789-.", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻·")
_SPACED = re.compile(r"\s*([+\u2212=])\s*")


def plain(equation: str) -> str:
    """The equation for a terminal: `ẍ = … − k3x x³`."""
    text = _POWER.sub(lambda found: (found[1] or found[2]).translate(_RAISED), _completed(equation))
    return text.replace("*", " ").replace("-", _OPERATORS["-"])


def typeset(equation: str) -> str:
    """HTML of an equation: symbols in italics, indices below, powers above."""
    parts = [_set(match) for match in _TOKEN.finditer(_completed(equation))]
    spaced = _SPACED.sub(lambda found: f" {found.group(1)} ", "".join(parts))
    return spaced.replace("  ", " ").strip()


def _completed(equation: str) -> str:
    """What is added to a side, as an equation that leaves out what was there; letters with their dots as one sign."""
    added = unicodedata.normalize("NFC", equation)
    return added.replace("+= -", "= … - ").replace("+=", "= … +")


def _set(match: re.Match[str]) -> str:
    if power := match["power"] or match["inner"]:
        return f"<sup>{escape(power.replace('-', _OPERATORS['-']))}</sup>"
    if name := match["name"]:
        return _name(name)
    if number := match["number"]:
        return number.rstrip("0").rstrip(".") if "." in number and "e" not in number else number
    return _OPERATORS.get(match["rest"], escape(match["rest"]))


def _name(name: str) -> str:
    """A letter with an index of digits or axes; anything longer is a word."""
    if name in _SYMBOLS:
        return f"<i>{_SYMBOLS[name]}</i>"
    letter, index = name[0], name[1:].lstrip("_")
    if not index:
        return f"<i>{escape(letter)}</i>"
    if name not in _UPRIGHT and len(index) <= _LONGEST_INDEX and (index[-1] in "xy" or any(map(str.isdigit, index))):
        return f"<i>{escape(letter)}</i><sub>{escape(index)}</sub>"
    return escape(name)
