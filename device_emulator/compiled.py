"""The compiler of the emulator's inner loop, with a disk cache that notices every change.

Numba notices a change in a function's own file but not in the functions it calls. So what it compiles lies in
a folder named after the content of the whole package: a change anywhere starts a fresh one.
"""

import hashlib
import os
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import numba

P = ParamSpec("P")
R = TypeVar("R")


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile `function` to machine code on first use and keep the result on disk for the next process.

    IEEE arithmetic is left alone (no fast-math), so one seed gives the same bytes in every run on a machine.
    """
    settings: Any = numba.config
    before = settings.CACHE_DIR
    settings.CACHE_DIR = str(_folder())
    try:
        return cast("Callable[P, R]", numba.njit(cache=True, error_model="numpy")(function))
    finally:
        settings.CACHE_DIR = before


@cache
def _folder() -> Path:
    """Below `GYROHIL_CACHE`, else inside the virtual environment, else in the user's cache folder."""
    digest = hashlib.sha256(f"{sys.version} {numba.__version__}".encode())
    package = Path(__file__).parent
    for source in sorted(package.rglob("*.py")):
        digest.update(str(source.relative_to(package)).encode() + b"\0" + source.read_bytes())
    if named := os.environ.get("GYROHIL_CACHE"):
        root = Path(named)
    elif sys.prefix != sys.base_prefix and os.access(sys.prefix, os.W_OK):
        root = Path(sys.prefix) / "var" / "cache" / "gyrohil"
    else:
        root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "gyrohil"
    return root / f"emulator-{digest.hexdigest()[:16]}"
