"""Effects that a trace tries only where it is asked to, as a user names them, and what it did not try."""

from collections.abc import Sequence

from estimator.effects.catalogue import effect_for, names
from estimator.settings import Device
from hil.errors import InputError
from hil.errors.strict_toml import suggestion


def effects_asked(words: Sequence[str], device: Device) -> tuple[str, ...]:
    """The effects of `--also`, each word a name or several with commas between them: none of two axes, where the whole
    catalogue is tried.

    Raises InputError, one line, for a name that is none, and for an effect that no trace of this device tries.
    """
    asked = tuple(dict.fromkeys(name.strip() for word in words for name in word.split(",")))
    tried = tuple(_tried(name, device) for name in asked)
    return tried if device.axes == 1 else ()


def _tried(name: str, device: Device) -> str:
    known = (*names(), *(effect.name for effect in device.own))
    if name not in known:
        raise InputError(f"--also: no effect {name!r}; {suggestion(name, known)}")
    declared = f"declare it as [effects.{name}] of the bench file"
    _, effect = effect_for(name, 2, device.own)
    if effect.declared_only:
        raise InputError(f"--also: {name}: no record tells it; {declared}")
    if effect.on(device.axes) is None:
        raise InputError(f"--also: {name}: needs two axes, and the device has one; leave it out")
    if effect.runs_freely and device.axes == 2:
        raise InputError(f"--also: {name}: traced on a single axis only; {declared}")
    given = [p.name for p in effect.parameters if p.default is None]
    if given and device.axes == 1:
        raise InputError(f"--also: {name}: no trace of this device searches for its {', '.join(given)}; {declared}")
    return name
