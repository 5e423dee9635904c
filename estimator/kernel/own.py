"""Code of effects that are not of the catalogue: compiled one by one on first use, kept by what they consist of.

Source and compiled code lie in `own` within the folder of this version of the kernels, named after the hash of the
source: the same declaration is compiled once, whatever it is called, and another one under the same name anew.
"""

import hashlib
import importlib.util
import os
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numba

from estimator.effects.declaration import Effect
from estimator.kernel.compiled import kernel_cache
from estimator.kernel.pointer import OWN_SIGNATURE
from estimator.model.declaration import Model

_lock = threading.RLock()
_known: dict[object, Any] = {}  # functions live as long as the process: their addresses are in observers


def address(effect: Effect, model: Model) -> int:
    """Address of the effect's function on that model; compiles it where the cache has none.

    Good in this process only, where it stays so.
    """
    with _lock:
        key = _key(effect, model)
        if key not in _known:
            path = _source(effect, model)
            _known[key] = _module(path).add
            path.with_suffix(".done").touch()
        return int(_known[key].address)


def is_compiled(effect: Effect, model: Model) -> bool:
    """Whether the effect's function is in memory or in the cache, so that it costs no compilation."""
    with _lock:
        return _key(effect, model) in _known or _source(effect, model).with_suffix(".done").exists()


def reached_by_address(function: Callable[..., Any]) -> Any:
    """A generated function made reachable by its address, its code kept beside its source; as in
    `estimator.kernel.compiled.compiled`, a division by zero gives infinity.
    """
    settings: Any = numba.config
    before = settings.CACHE_DIR
    settings.CACHE_DIR = str(kernel_cache() / "numba")
    try:
        return numba.cfunc(OWN_SIGNATURE, cache=True, error_model="numpy")(function)
    finally:
        settings.CACHE_DIR = before


def _key(effect: Effect, model: Model) -> object:
    """What the function consists of."""
    coefficients = tuple(coefficient.symbol for coefficient in effect.coefficients)
    signals = tuple(signal.symbol for signal in effect.signals)
    return model.name, effect.force, effect.sense, coefficients, signals


def _source(effect: Effect, model: Model) -> Path:
    """The file of the effect's source, written if absent."""
    from estimator.model.codegen import own_effect

    text = own_effect(model, effect)
    path = kernel_cache() / "own" / f"effect_{hashlib.sha256(text.encode()).hexdigest()[:16]}.py"
    if not path.exists():
        path.parent.mkdir(exist_ok=True)
        scratch = path.with_suffix(f".{os.getpid()}.tmp")
        scratch.write_text(text)
        scratch.replace(path)
    return path


def _module(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"{path}: cannot be loaded; delete its folder and start again")
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module  # before executing: Numba's cache looks the module up by name
    spec.loader.exec_module(module)
    return module
