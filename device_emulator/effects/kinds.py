"""Every hidden effect by name, and `python -m device_emulator.effects.kinds FILE`: their numbers as a C enum.

A number is the effect's place among the names: no file and no frame has it. Loads the standard library alone, as the
build has no more.
"""

import sys
from pathlib import Path

from device_emulator.effects import drive, force, sense
from device_emulator.effects.declaration import Declaration

DECLARATIONS: dict[str, Declaration] = force.DECLARATIONS | drive.DECLARATIONS | sense.DECLARATIONS
NUMBERS = {name: number for number, name in enumerate(DECLARATIONS)}
NAMES = " ".join(DECLARATIONS)
"""What Python and the compiled library compare when it is loaded."""


def header() -> str:
    """The C header: the enum, and the names in its order."""
    members = "".join(f"    {name.upper()},\n" for name in DECLARATIONS)
    written = "/* Written by device_emulator/effects/kinds.py. */"
    return f'{written}\nenum effect_kind {{\n{members}}};\n#define EFFECT_NAMES "{NAMES}"\n'


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(header(), encoding="ascii")
