"""The C compiler of this machine, and how all of ours is compiled: libraries of a wheel, laws of one's own.

`compile_native.py` loads this file by its path, before anything is installed: it imports nothing else.
"""

import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

FLAGS = (
    "-std=c99",
    "-O3",
    "-ffp-contract=off",  # so that one instruction set gives one result
    "-fno-math-errno",
    "-fvisibility=hidden",
    "-fPIC",
    "-shared",
)
WARNINGS = ("-Wall", "-Wextra", "-Werror", "-Wconversion", "-Wno-psabi")  # lanes of four go to inlined functions only
CURES = "sudo apt install gcc libc6-dev, or pip install 'gyrohil[compiler]'"


class CompilerError(Exception):
    """There is no compiler, or it failed; the message is one line."""


def command() -> list[str]:
    """The command of a C99 compiler: `$CC`, cc, gcc, clang, or the package ziglang, which needs no root; else empty."""
    if named := os.environ.get("CC"):
        return shlex.split(named)
    for name in ("cc", "gcc", "clang"):
        if found := shutil.which(name):
            return [found]
    if find_spec("ziglang"):
        return [sys.executable, "-m", "ziglang", "cc", "-mcpu=baseline"]  # without it: for this very processor
    return []


def compile_library(sources: Sequence[Path], library: Path, flags: Sequence[str] = ()) -> None:
    """Compile and link the sources; the library is whole or absent, though a process may have the old one open.

    Raises CompilerError.
    """
    called = command()
    if not called:
        raise CompilerError(f"no C compiler: {CURES}")
    library.parent.mkdir(parents=True, exist_ok=True)
    scratch = library.with_name(f"{library.name}.{os.getpid()}")
    try:
        done = subprocess.run(
            [*called, *FLAGS, *flags, "-o", scratch, *sources, "-lm"], capture_output=True, text=True, check=False
        )
    except OSError as error:
        raise CompilerError(f"{called[0]}: {error.strerror}; {CURES}") from error
    if done.returncode != 0:
        scratch.unlink(missing_ok=True)
        said = [line for line in done.stderr.splitlines() if "error" in line] or done.stderr.splitlines() or ["no word"]
        raise CompilerError(f"{' '.join(called)} failed on {sources[0].name}: {said[0].strip()}; {CURES}")
    scratch.replace(library)
