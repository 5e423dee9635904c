"""Code of effects that are not of the catalogue: compiled one by one on first use, kept by what they consist of.

Its C text and the library of it lie in the folder `own` of the cache, named after the hash of the text: the same
declaration is compiled once, whatever it is called, and another one under the same name anew.
"""

import ctypes
import hashlib
import os
import platform
import sys
import threading
from pathlib import Path

from estimator.core.compiler import FLAGS, CompilerError, compile_library
from estimator.core.generate.own import own_effect
from estimator.effects.declaration import Effect
from estimator.errors import ModelError
from estimator.model.declaration import Model

_HEADERS = tuple(Path(__file__).with_name(name) for name in ("own.h", "layout.h"))

_lock = threading.RLock()
_known: dict[object, int] = {}
_open: list[ctypes.CDLL] = []  # libraries stay as long as the process: addresses in them are in observers


def address(effect: Effect, model: Model) -> int:
    """Address of the effect's function on that model; compiles it where the cache has none.

    Good in this process only, where it stays so.  Raises ModelError where it cannot be compiled.
    """
    with _lock:
        key = _key(effect, model)
        if key not in _known:
            library = _library(own_effect(model, effect))
            if not library.exists():
                _compile(effect, own_effect(model, effect), library)
            _open.append(ctypes.CDLL(str(library)))
            _known[key] = ctypes.cast(_open[-1].add, ctypes.c_void_p).value or 0
        return _known[key]


def is_compiled(effect: Effect, model: Model) -> bool:
    """Whether the effect's function is in memory or in the cache, so that it costs no compilation."""
    with _lock:
        return _key(effect, model) in _known or _library(own_effect(model, effect)).exists()


def cache_folder() -> Path:
    """`GYROHIL_CACHE`, else inside the virtual environment, else the user's cache folder."""
    if named := os.environ.get("GYROHIL_CACHE"):
        return Path(named)
    if sys.prefix != sys.base_prefix and os.access(sys.prefix, os.W_OK):
        return Path(sys.prefix) / "var" / "cache" / "gyrohil"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "gyrohil"


def _compile(effect: Effect, text: str, library: Path) -> None:
    source = library.with_suffix(f".{os.getpid()}.c")
    try:
        source.parent.mkdir(parents=True, exist_ok=True)
        source.write_text(text, encoding="utf-8")
        compile_library([source], library, (f"-I{_HEADERS[0].parent}",))
        source.replace(library.with_suffix(".c"))
    except (CompilerError, OSError) as error:
        source.unlink(missing_ok=True)
        raise ModelError(f"effect {effect.name}: {error}") from error


def _key(effect: Effect, model: Model) -> object:
    """What the function consists of."""
    coefficients = tuple(coefficient.symbol for coefficient in effect.coefficients)
    signals = tuple(signal.symbol for signal in effect.signals)
    return model.name, effect.force, effect.sense, coefficients, signals


def _library(text: str) -> Path:
    made_of = "\0".join((text, platform.machine(), *FLAGS, *(path.read_text(encoding="utf-8") for path in _HEADERS)))
    return cache_folder() / "own" / f"effect_{hashlib.sha256(made_of.encode()).hexdigest()[:16]}.so"
