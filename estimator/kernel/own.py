"""Code of effects that are not of the catalogue: compiled one by one on first use, kept by what they consist of.

Source and compiled code lie in `own` within the folder of this version of the kernels, named after the hash of the
source: the same declaration is compiled once, whatever it is called, and another one under the same name anew.
"""

import hashlib
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba

from estimator.effects.declaration import Effect
from estimator.kernel.compiled import kernel_cache, loaded, written
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
            _known[key] = loaded(path).add
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
    from estimator.kernel.generate.model import own_effect

    text = own_effect(model, effect)
    name = f"effect_{hashlib.sha256(text.encode()).hexdigest()[:16]}.py"
    return written(kernel_cache() / "own" / name, lambda: text)
