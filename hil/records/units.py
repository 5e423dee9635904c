"""Column names carry their unit (`kxx_per_s2`, `angle_rad`); this is the one place that reads it."""

_BY_SUFFIX = {
    "_mps2": "m/s²",
    "_mps": "m/s",
    "_m": "m",
    "_V": "V",
    "_N": "N",
    "_rad_s": "rad/s",
    "_rad": "rad",
    "_per_s2": "1/s²",
    "_per_s": "1/s",
    "_ns": "ns",
    "_s": "s",
    "_kg": "kg",
    "_Hz": "Hz",
    "_N_per_m": "N/m",
    "_N_s_per_m": "N·s/m",
    "_V_per_m": "V/m",
    "_V_per_s": "V/s",
    "_N_per_m_per_V2": "N/m/V²",
    "_N_per_V": "N/V",
    "_V_s_per_rad": "V·s/rad",
    "_mps2_per_rtHz": "m/s²/√Hz",
    "_deg": "°",
    "_dps": "°/s",
    "_ppm": "ppm",
    "_C": "°C",
    "_T": "T",
    "_Pa": "Pa",
    "_ratio": "1",
}
_LONGEST_FIRST = sorted(_BY_SUFFIX, key=len, reverse=True)


def unit_of(column: str) -> str:
    """Unit of a column by its suffix, "" when the name has none (flags, codes, counts).

    >>> unit_of("kxx_per_s2"), unit_of("rate_rad_s"), unit_of("flags")
    ('1/s²', 'rad/s', '')
    """
    return next((_BY_SUFFIX[suffix] for suffix in _LONGEST_FIRST if column.endswith(suffix)), "")


def symbol_of(column: str) -> str:
    """The column's name without its unit.

    >>> symbol_of("kxx_per_s2")
    'kxx'
    """
    return next((column.removesuffix(suffix) for suffix in _LONGEST_FIRST if column.endswith(suffix)), column)


LEVELS = ("dB", "dBV", "dBmV", "dBuV", "dBµV", "dBμV", "dBu", "dBm", "dBW", "dBr", "dBc", "dBFS", "dBSPL", "dBg")
"""Units of levels: 20 times the decimal logarithm of an amplitude over a reference, whatever that is."""
