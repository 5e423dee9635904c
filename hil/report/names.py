"""How a quantity is called on the page."""

_SYMBOLS = {
    "x": "x",
    "vx": "ẋ",
    "y": "y",
    "vy": "ẏ",
    "phi_x": "Φx",
    "phi_y": "Φy",
    "rate": "Ω",
}


def shown(symbol: str) -> str:
    """`phi_x` → `Φx`, `drive_gain_x` → `drive gain x`; others as they are."""
    return _SYMBOLS.get(symbol, symbol.replace("_", " "))


def shown_unit(unit: str) -> str:
    """The unit, nothing for a pure number."""
    return "" if unit == "1" else unit


def rank(symbol: str) -> tuple[int, str]:
    """Sort key: stiffness, damping, other coefficients, offsets; the diagonal before the cross term."""
    if symbol.startswith("phi_"):
        return 3, symbol
    group = {"k": 0, "d": 1}.get(symbol[0], 2) if symbol[1:] in ("xx", "yy", "xy") else 2
    return group, symbol.replace("xy", "zz")
