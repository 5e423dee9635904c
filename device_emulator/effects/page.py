"""The reference page of hidden effects, written from their declarations: `python -m device_emulator.effects.page`."""

from enum import IntEnum

from device_emulator.effects.catalogue import DECLARATIONS
from device_emulator.effects.declaration import Coefficient, Declaration

_INTRODUCTION = """\
# Hidden effects of an emulated board

What a scenario can give the emulated board that its data sheet does not declare, one table each:

    [[effect]]
    name = "cubic_stiffness"
    k3x = 1.0e13

Per unit mass, SI. Several add up, in their order; coefficients marked (given) must be, the others are 0 without it.
T - T0 is what `[temperature]` makes of the board: `warm_up_K` (with `time_constant_s`) and `swing_K` (with `period_s`)
from `start_C` on; the wire does not tell it. Rf of the charge integrators (`feedback_ohm`), their low-pass, 1/f noise
and drift stand in `[sense]`, a clock that runs fast in `[faults]` (`clock_skew`). Definitions here are the emulator's
own; the observer's are in [effects](effects.md).
Generated: `python -m device_emulator.effects.page`.

| effect | adds | coefficients |
|---|---|---|
"""


def page() -> str:
    """The whole page in Markdown."""
    return _INTRODUCTION + "".join(_row(kind, declaration) for kind, declaration in DECLARATIONS.items())


def _row(kind: IntEnum, declaration: Declaration) -> str:
    coefficients = ", ".join(map(_coefficient, declaration.coefficients))
    equation = declaration.equation.replace("|", "\\|")
    return f"| `{kind.name.lower()}` | {equation} | {coefficients} |\n"


def _coefficient(coefficient: Coefficient) -> str:
    given = " (given)" if coefficient.default is None else ""
    return f"`{coefficient.symbol}` [{coefficient.unit}]{given}"


if __name__ == "__main__":
    print(page(), end="")
