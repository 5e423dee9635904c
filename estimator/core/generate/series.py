"""For each order of a Taylor series, the longest interval that it does for."""

import math

_MOST_TERMS = 60
_NORM = 1.5
_TOLERANCES = {"LONGEST": 1e-14, "LONGEST_WITHIN": 1e-11}


def tables() -> list[str]:
    """Two tables: of the linear motion, and where a rule of Gauss, less exact, is to be kept.

    Order n leaves (t norm)^(n+1)/(n+1)!, which is to be below a tolerance.
    """
    lines = []
    for name, tolerance in _TOLERANCES.items():
        longest = [(tolerance * math.factorial(n + 1)) ** (1.0 / (n + 1)) / _NORM for n in range(_MOST_TERMS)]
        rows = [", ".join(f"R({t!r})" for t in longest[n : n + 5]) for n in range(0, _MOST_TERMS, 5)]
        lines += [f"static const real {name}[MOST_TERMS] = {{", *(f"    {row}," for row in rows), "};"]
    return lines
