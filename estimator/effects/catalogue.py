"""All effects, in the order of their numbers: what the modules beside this one declare."""

from collections.abc import Iterable, Sequence
from types import ModuleType

from estimator.effects import damping, delay, drive, hysteresis, line, sense, stiffness, temperature
from estimator.effects import indistinguishable as equivalent
from estimator.effects.declaration import OWN, Effect
from estimator.errors import ModelError


def collected(modules: Iterable[ModuleType]) -> tuple[Effect, ...]:
    """The effects that the modules declare, in the order of their numbers."""
    declared = (item for module in modules for item in vars(module).values() if isinstance(item, Effect))
    return tuple(sorted(declared, key=lambda effect: effect.number))


EFFECTS = collected((stiffness, hysteresis, damping, sense, drive, delay, line, temperature, equivalent))


def names() -> tuple[str, ...]:
    """Names of all effects."""
    return tuple(effect.name for effect in EFFECTS)


def effect_for(name: str, axes: int, own: Sequence[Effect] = ()) -> tuple[int, Effect]:
    """Number and declaration of an effect on a device with that many axes; `own` are those beside the catalogue.

    An effect that is there more than once has a label behind a colon, `interference:2`.

    Raises ModelError for an unknown name, and for an effect of which a single axis has nothing.
    """
    kind, _, label = name.partition(":")
    known = (*names(), *(effect.name for effect in own))
    if kind not in known:
        raise ModelError(f"no effect {kind!r}; known: {', '.join(known)}")
    index = known.index(kind)
    number = index if index < len(EFFECTS) else OWN
    effect = (*EFFECTS, *own)[index].on(axes)
    if effect is None:
        raise ModelError(f"effect {kind!r} needs two axes")
    return number, effect.labelled(label) if label else effect
