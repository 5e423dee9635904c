"""The reference page of effects, written from their declarations: `python -m estimator.effects.page`."""

import sympy as sp

from estimator.effects.catalogue import EFFECTS
from estimator.effects.declaration import Effect

_INTRODUCTION = """\
# Effects

What a gyro can have beyond the base model (2), as the observer can carry it. An effect is switched on in the bench
file, `[effects.NAME]`, with first guesses of its coefficients; they are estimated with everything else, and what the
effect does is undone as its entry says. Per unit mass, SI. Generated: `python -m estimator.effects.page`.
"""


def page() -> str:
    """The whole page in Markdown."""
    return _INTRODUCTION + "".join(_entry(effect) for effect in EFFECTS)


def _entry(effect: Effect) -> str:
    lines = [f"\n## {effect.name}\n\n{effect.title}.\n"]
    for what, expressions in (("force", effect.force), ("sensed displacement", effect.sense)):
        for axis, expression in zip("xy", expressions, strict=True):
            if expression != 0:
                lines.append(f"- {what} {axis}: `+ {sp.sstr(expression)}`")
    lines.append("- coefficients: " + ", ".join(f"`{c.name}` [{c.unit}]" for c in effect.coefficients))
    lines.append(f"- signature: {effect.signature}")
    for name, separator in effect.look_alikes.items():
        lines.append(f"- looks like {name.replace('_', ' ')}; told apart: {separator}")
    lines.append(f"- undone: {effect.undone.value}")
    lines.append(f"- source: {effect.source}")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    print(page(), end="")
