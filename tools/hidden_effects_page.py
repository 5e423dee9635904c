"""The table of the reference page of hidden effects."""

from device_emulator.effects.declaration import HiddenCoefficient
from device_emulator.effects.kinds import DECLARATIONS
from tools.markdown import table


def effects() -> str:
    """What each adds, with its coefficients."""
    rows = (
        (f"`{name}`", declaration.equation, ", ".join(map(_coefficient, declaration.coefficients)))
        for name, declaration in DECLARATIONS.items()
    )
    return table(("effect", "adds", "coefficients"), rows)


def _coefficient(coefficient: HiddenCoefficient) -> str:
    given = " (given)" if coefficient.default is None else ""
    return f"`{coefficient.symbol}` [{coefficient.unit}]{given}"
