"""The reference page of hidden effects, written from their declarations: `python -m device_emulator.effects.page`."""

from enum import IntEnum

from device_emulator.effects.catalogue import DECLARATIONS
from device_emulator.effects.declaration import Declaration, HiddenCoefficient

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
own; the observer's are in [effects](effects.md), with other coefficients where the last table says so.
Generated: `python -m device_emulator.effects.page`.

| effect | adds | coefficients |
|---|---|---|
"""


_CATALOGUE = """
## In the coefficients of the catalogue

Where the two pages have other coefficients. G is the declared sense gain of the axis in V/m with its sign, Ts the time
between two samples; where the table says x, y goes alike. The observer counts time from one Ts before the first sample.
An x that is measured too large is `gy` below zero there, beside another gain of the drive: x is the unit of length
([look-alikes](../explanation.md)).

| here | in [effects](effects.md) |
|---|---|
| `sense_gain` `gx` | none |
| `drive_feedthrough` `gamma_x` | `fdx` = gamma_x / G |
| `interference` `ax`, `phase_x` | `lsx` = ax cos(p) / G, `lcx` = ax sin(p) / G, p = phase_x - 2 pi f Ts |
| `base_vibration` `ax`, `phase_x` | `bsx` = ax cos(p), `bcx` = ax sin(p) with the same p |
| `sense_clipping` `limit_x` | `level` = limit_x / \\|G\\|, of displacement and offset together |
| `dry_friction_asymmetric` `fx`, `ax` | `dry_friction` with `fx`, and beside it `fax` = fx ax |
| `drive_saturation` `limit_x`, `drive_dead_band` `width_x` | `limit`, `band`, with `sx`, `zx` = 1 |
| `temperature_stiffness` `tc` | `ktx` = tc kxx, `kty` = tc kyy, `ktxy` = tc kxy; damping alike |
| `temperature_offset` `tc_x` | `ptx` = tc_x / G |
"""


def page() -> str:
    """The whole page in Markdown."""
    rows = "".join(_row(kind, declaration) for kind, declaration in DECLARATIONS.items())
    return f"{_INTRODUCTION}{rows}{_CATALOGUE}"


def _row(kind: IntEnum, declaration: Declaration) -> str:
    coefficients = ", ".join(map(_coefficient, declaration.coefficients))
    equation = declaration.equation.replace("|", "\\|")
    return f"| `{kind.name.lower()}` | {equation} | {coefficients} |\n"


def _coefficient(coefficient: HiddenCoefficient) -> str:
    given = " (given)" if coefficient.default is None else ""
    return f"`{coefficient.symbol}` [{coefficient.unit}]{given}"


if __name__ == "__main__":
    print(page(), end="")
