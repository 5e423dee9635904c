"""Numba with a disk cache keyed by what the kernels are made of.

Numba notices a change in a function's own file but not in the functions it calls, and the generated module depends on
the declarations.  So generated source and compiled code live in one folder named after the hash of every file that
decides them.  A change anywhere starts a fresh folder; a hit compiles nothing.
"""

import hashlib
import importlib.util
import os
import sys
from collections.abc import Callable
from functools import cache
from importlib.metadata import version
from pathlib import Path
from types import ModuleType
from typing import Any

import numba

_ESTIMATOR = Path(__file__).parents[1]
_OPTIONS: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
_GENERATED = "estimator_generated_model"

COMMON = "the kernels"
GAIN_MODE = "the kernels of gain mode"
STATIONARY = "the kernels of the stationary gain"
"""What is compiled together: what every run and trace needs, and what few do, which is left to the first that does."""


def _cache_root() -> Path:
    """`GYROHIL_CACHE`, else inside the virtual environment, else the user's cache folder."""
    if named := os.environ.get("GYROHIL_CACHE"):
        return Path(named)
    if sys.prefix != sys.base_prefix and os.access(sys.prefix, os.W_OK):
        return Path(sys.prefix) / "var" / "cache" / "gyrohil"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "gyrohil"


@cache
def kernel_cache() -> Path:
    """Folder of this very version of the kernels; made if absent."""
    digest = hashlib.sha256(f"{sys.version} {numba.__version__} {version('sympy')}".encode())
    rooms = ("model", "effects", "kernel")
    for source in sorted(path for room in rooms for path in (_ESTIMATOR / room).rglob("*.py")):
        digest.update(str(source.relative_to(_ESTIMATOR)).encode() + b"\0" + source.read_bytes())
    folder = _cache_root() / digest.hexdigest()[:16]
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def is_warm(kernels: str = COMMON) -> bool:
    """Whether they were compiled before, so that first use costs a load and not a compilation."""
    return _mark(kernels).exists()


def mark_warm(kernels: str = COMMON) -> None:
    """Note that they are in the cache."""
    _mark(kernels).touch()


def _mark(kernels: str) -> Path:
    return kernel_cache() / kernels.replace(" ", "-")


def compiled(function: Callable[..., Any], *, inline: bool = False, counts: bool = True) -> Callable[..., Any]:
    """`numba.njit` with the cache in `kernel_cache()`; the interpreter's global setting is left as it was.

    A division by zero gives infinity, as in NumPy: a filter that diverges ends in numbers that say so.  With `inline`
    it becomes part of every kernel that calls it.  What makes no array need not count references to those it is given,
    `counts`: with many branches, Numba finds no way to leave that out by itself.  None has the entry that C would call,
    which takes time to compile: what is reached by its address is compiled as such (`estimator.kernel.own`).
    """
    settings: Any = numba.config
    before = settings.CACHE_DIR
    settings.CACHE_DIR = str(kernel_cache() / "numba")
    options = _OPTIONS | {"forceinline": inline, "_nrt": counts}
    try:
        kernel: Callable[..., Any] = numba.njit(**options)(function)
        return kernel
    finally:
        settings.CACHE_DIR = before


def inlined(function: Callable[..., Any]) -> Callable[..., Any]:
    """`compiled`, for short functions of many arguments that are called for every sample."""
    return compiled(function, inline=True)


def branching(function: Callable[..., Any]) -> Callable[..., Any]:
    """`compiled`, for functions of many branches that make no array."""
    return compiled(function, counts=False)


@cache
def generated() -> ModuleType:
    """The module generated from the declarations, written on the first use of this version and loaded ever after."""

    def source() -> str:
        from estimator.effects.catalogue import EFFECTS
        from estimator.kernel.generate.model import generate
        from estimator.model.catalogue import MODELS

        return generate(MODELS, EFFECTS)

    return loaded(written(kernel_cache() / f"{_GENERATED}.py", source))


def written(path: Path, source: Callable[[], str]) -> Path:
    """The file of a generated module, written if absent: whole, though other processes may be at it as well."""
    if not path.exists():
        path.parent.mkdir(exist_ok=True)
        scratch = path.with_suffix(f".{os.getpid()}.tmp")
        scratch.write_text(source())
        scratch.replace(path)
    return path


def loaded(path: Path) -> ModuleType:
    """The module in a file, by the file's name. Raises ImportError."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"{path}: cannot be loaded; delete its folder and start again")
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module  # before executing: Numba's cache looks the module up by name
    spec.loader.exec_module(module)
    return module
