"""What compiles for a board here, and what emulates one: for `hil generate` and the tests of boards."""

import shutil
from collections.abc import Iterator

from hil.doctor.finding import Finding

NEEDED = (
    ("arm-none-eabi-gcc", "compiler for boards", "gcc-arm-none-eabi libnewlib-arm-none-eabi"),
    ("qemu-system-arm", "emulated processor", "qemu-system-arm"),
)
"""Command, what it is, the Debian packages that bring it."""


def examine() -> Iterator[Finding]:
    """A finding for each of what generated code is measured and tested with."""
    for command, subject, packages in NEEDED:
        if found := shutil.which(command):
            yield Finding(subject, "good", found)
        else:
            told = f"no {command}: code for a Cortex-M7 is not measured or tested here"
            yield Finding(subject, "missing", told, f"sudo apt install {packages}")
