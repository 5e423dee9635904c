"""Compile the C sources of the packages into shared libraries beside them: `python compile_native.py`.

The wheel's build hook and `make install` run it.  Any C99 compiler serves: `$CC`, cc, gcc, clang, or the package
ziglang, which needs no root.
"""

import importlib.util
import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

LIBRARIES = {
    "device_emulator/native/libdevice.so.1": ("device_emulator/native/device.c",),
    "hil/loop/native/libturn.so.1": ("hil/loop/native/turn.c", "firmware/src/hil_spec.c"),
}
"""What is built, from which sources; paths from the root of the project."""

FLAGS = ("-std=c99", "-O3", "-ffp-contract=off", "-fno-math-errno", "-fvisibility=hidden", "-fPIC", "-shared")
WARNINGS = ("-Wall", "-Wextra", "-Werror", "-Wconversion")


def compiler() -> list[str]:
    """The command of a C compiler, empty where there is none."""
    if named := os.environ.get("CC"):
        return shlex.split(named)
    for name in ("cc", "gcc", "clang"):
        if found := shutil.which(name):
            return [found]
    return [sys.executable, "-m", "ziglang", "cc"] if importlib.util.find_spec("ziglang") else []


def main() -> None:
    """Compile each library; exit with one line where it cannot be done."""
    command, root = compiler(), Path(__file__).parent
    if not command:
        sys.exit("compile_native: no C compiler; sudo apt install gcc libc6-dev, or pip install ziglang")
    for library, sources in LIBRARIES.items():
        scratch = root / f"{library}.{os.getpid()}"  # whole or absent, though a process may have the old one open
        try:
            paths = [root / source for source in sources]
            subprocess.run([*command, *FLAGS, *WARNINGS, "-o", scratch, *paths, "-lm"], check=True)
        except (OSError, subprocess.CalledProcessError) as error:
            sys.exit(f"compile_native: {sources[0]} was not compiled: {error}")
        scratch.replace(root / library)


if __name__ == "__main__":
    main()
