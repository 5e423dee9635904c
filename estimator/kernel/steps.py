"""Filter steps of their own (`estimator.kernel.generate.step`): compiled once for each set of effects, kept by what
they are of.

Source and compiled code lie in `steps` within the folder of this version of the kernels.  Who does not ask for one has
the general kernels, which do the same several times slower; GYROHIL_KERNEL=general in the environment has them do
everything, what `estimator.kernel.plain` is for as well.
"""

import hashlib
import os
import threading
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from types import ModuleType

from estimator.effects.declaration import Effect
from estimator.kernel.compiled import kernel_cache, loaded, written
from estimator.model.declaration import Model

_SWITCH = "GYROHIL_KERNEL"
_lock = threading.RLock()
_known: dict[str, ModuleType] = {}


def wanted() -> bool:
    """Whether the environment leaves kernels for one set of effects, or for none, on."""
    return os.environ.get(_SWITCH, "") != "general"


@cache
def base_step(name: str = "gyro") -> ModuleType:
    """The instance without effects, of which the kernels of 13 states are made."""
    from estimator.model.catalogue import MODELS

    return module_of(next(model for model in MODELS if model.name == name), ())


def is_compiled(model: Model, effects: Sequence[Effect]) -> bool:
    """Whether the step is in the cache, so that it costs a load and no compilation."""
    return _path(model, effects).with_suffix(".done").exists()


def module_of(model: Model, effects: Sequence[Effect]) -> ModuleType:
    """The step's module; its source is written if absent, and compiled on first use."""
    path = _path(model, effects)
    with _lock:
        if path.stem not in _known:
            from estimator.kernel.generate.step import step_source

            _known[path.stem] = loaded(written(path, lambda: step_source(model, effects)))
        return _known[path.stem]


def mark_compiled(model: Model, effects: Sequence[Effect]) -> None:
    """Note that the step's kernels are in the cache."""
    _path(model, effects).with_suffix(".done").touch()


def _path(model: Model, effects: Sequence[Effect]) -> Path:
    """Where the step's source is, by what it consists of, whatever the effects are called."""
    parts = [model.name]
    for effect in effects:
        coefficients = [str(coefficient.symbol) for coefficient in effect.coefficients]
        signals = [(str(signal.symbol), signal.source.name) for signal in effect.signals]
        parts.append(f"{effect.force} {effect.sense} {coefficients} {signals}")
    digest = hashlib.sha256("\n".join(parts).encode()).hexdigest()[:16]
    return kernel_cache() / "steps" / f"step_{digest}.py"
