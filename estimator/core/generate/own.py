"""The C text of one effect that is not of the catalogue: a library of its own, called by its address (own.h)."""

from estimator.core.generate.effects import ARGUMENTS, FORCE, NAMES, SENSE, body
from estimator.effects.declaration import Effect
from estimator.model.declaration import Model

_HEAD = f"""/* Written from the declaration of one effect; not to be edited. */
#include "own.h"

EXPORTED OwnEffect add;

void add(whole what, {ARGUMENTS})
{{"""


def own_effect(model: Model, effect: Effect) -> str:
    """A source with `add`, which does for one effect what model.h does for those of the catalogue."""
    lines = [_HEAD, "    " + " ".join(f"(void){name};" for name in NAMES.split(", "))]
    for what in (FORCE, SENSE):
        added = body(model, effect, what)
        if added:
            lines += [f"    if (what == OWN_{what.upper()}) {{", *("        " + line for line in added), "    }"]
    return "\n".join([*lines, "}"]) + "\n"
