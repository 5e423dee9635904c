"""Effects beside the catalogue: declared in the bench file, or brought by packages as entry points of `hil.effects`.

    [project.entry-points."hil.effects"]
    quintic_stiffness = "my_package:QUINTIC"

The entry point has the name of its effect and leads to an `estimator.custom.Declaration`, or to an
`estimator.effects.declaration.Effect` for what a law of text cannot say.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from importlib.metadata import EntryPoint, entry_points
from typing import TYPE_CHECKING, Any

from estimator.custom import Declaration
from estimator.custom.declaration import UNNAMED
from estimator.custom.sensing import declared_map
from estimator.errors import ModelError
from estimator.settings import Device
from hil.bench import Bench
from hil.bench.effects import GROUP
from hil.errors import InputError, printable

if TYPE_CHECKING:
    from estimator.effects.declaration import Effect


@dataclass(frozen=True)
class Packaged:
    """What the installed packages bring, by name; broken: a line for each entry point that cannot be used."""

    effects: "Mapping[str, Declaration | Effect]" = field(default_factory=dict)
    broken: Mapping[str, str] = field(default_factory=dict)


def packaged() -> Packaged:
    """The effects of all installed packages."""
    found: dict[str, Declaration | Effect] = {}
    broken: dict[str, str] = {}
    for entry in sorted(entry_points(group=GROUP), key=lambda entry: entry.name):
        try:
            found[entry.name] = _loaded(entry)
        except ModelError as error:
            broken[entry.name] = f"effect {entry.name!r} of {_package(entry)}: {error}"
    return Packaged(found, broken)


def may_have_any(bench: Bench) -> bool:
    """Whether the bench file or a package declares one; quickly known."""
    return bench.device.sense.interface.kind != "comb" or bool(bench.effects.custom) or bool(entry_points(group=GROUP))


def own_effects(bench: Bench, device: Device) -> "tuple[Effect, ...]":
    """The effects beside the catalogue that `device`, that of `bench`, can have, those of the bench file first.

    What a package brings and cannot be used is left out.  Raises InputError where `bench` itself declares or names
    such an effect.
    """
    if not may_have_any(bench):
        return ()
    from estimator.custom.building import built  # SymPy

    taken = _Taken()
    axes, scaling = device.axes, _scaling(device)
    if device.interface is not None and (map_ := declared_map(device.interface)) is not None:
        taken.add(built(map_, scaling, axes))
    for name, one in bench.effects.custom.items():
        try:
            taken.add(built(one.declared(name), scaling, axes))
        except ModelError as error:
            raise InputError(f"[effects.custom.{name}] {error}") from None
    brought = packaged()
    named = {name.partition(":")[0] for name in bench.effects.named} - set(bench.effects.custom)
    if wrong := sorted(named & set(brought.broken)):
        raise InputError(brought.broken[wrong[0]])
    for name, declared in brought.effects.items():
        try:
            taken.add(built(declared, scaling, axes) if isinstance(declared, Declaration) else declared)
        except ModelError as error:
            if name in named:
                raise InputError(f"[effects.{name}] {error}") from None
    return tuple(taken.effects)


def included(bench: Bench) -> dict[str, dict[str, float]]:
    """The effects that the observer of `bench` includes, with initial values: those named, and those declared."""
    sensed = bench.device.sense.interface.map(bench.device.axes, math.sqrt(bench.target_stiffness_per_s2))
    interface = {} if (map_ := declared_map(sensed)) is None else {map_.name: map_.start}
    known = {name: one.declared(name).start for name, one in bench.effects.custom.items()}
    if set(bench.effects.named) - set(known):
        known |= {name: one.start for name, one in packaged().effects.items() if isinstance(one, Declaration)}
    effects = {name: {**known.get(name.partition(":")[0], {}), **given} for name, given in bench.effects.named.items()}
    declared = {name: known[name] for name, one in bench.effects.custom.items() if one.carried}
    return {**interface, **effects, **{name: given for name, given in declared.items() if name not in effects}}


def left_out() -> list[str]:
    """A line for each effect of a package that cannot be used for what is wrong with it."""
    return [f"{line}; it is left out" for line in packaged().broken.values()]


class _Taken:
    """Names of effects and coefficients that are in use: an observer knows both by name."""

    def __init__(self) -> None:
        from estimator.effects.catalogue import EFFECTS

        self.effects: list[Effect] = []
        self.names = {effect.name: "the catalogue has" for effect in EFFECTS}
        self.coefficients = {c.name: effect.name for effect in EFFECTS for c in effect.coefficients}

    def add(self, effect: "Effect") -> None:
        if effect.name in self.names:
            raise ModelError(f"{self.names[effect.name]} an effect {effect.name!r} already; take another name")
        for coefficient in effect.coefficients:
            if (owner := self.coefficients.get(coefficient.name)) is not None:
                raise ModelError(
                    f"coefficients.{coefficient.name}: effect {owner!r} has one of that name; take another"
                )
        self.names[effect.name] = "the bench file or a package declares"
        self.coefficients |= {coefficient.name: effect.name for coefficient in effect.coefficients}
        self.effects.append(effect)


def _scaling(device: Device) -> Any:
    from estimator.scaling import Scaling

    return Scaling.of(device)


def _loaded(entry: EntryPoint) -> "Declaration | Effect":
    """What the entry point leads to; ModelError, one line, for whatever goes wrong on the way or is no effect."""
    from estimator.effects.declaration import Effect

    try:
        found: Declaration | Effect = entry.load()
    except ModelError as error:
        raise ModelError(f"{error}; mend or uninstall it") from None
    except (Exception, SystemExit) as error:  # noqa: BLE001  # whatever another's module does while it is imported
        said = printable(" ".join(str(error).split()))[:200]
        raise ModelError(f"{type(error).__name__}: {said}; mend or uninstall it") from None
    if isinstance(found, Effect):
        _require_sound(found)
    elif not isinstance(found, Declaration):
        raise ModelError(
            f"{entry.value} is a {type(found).__name__}, not a Declaration or an Effect; mend or uninstall it"
        )
    if found.name != entry.name:
        raise ModelError(f"its effect is called {found.name!r}; give both the same name")
    return replace(found, source=_package(entry)) if found.source == UNNAMED else found


def _require_sound(effect: "Effect") -> None:
    """ModelError for an Effect that speaks of symbols that it does not declare."""
    import sympy as sp

    from estimator.custom.declaration import NAME
    from estimator.effects.declaration import DRIVES, STATES
    from estimator.model.catalogue import MODELS

    if not NAME.fullmatch(effect.name):
        raise ModelError("name: begins with a small letter and has small letters, digits and _ only, 40 at most")
    if effect.delayed is not None:
        raise ModelError("delayed: a delay is the catalogue's; declare a force or what is sensed")
    constants = [constant.symbol for model in MODELS for constant in model.constants]
    declared: set[Any] = {*STATES, *DRIVES, *constants}
    declared |= {one.symbol for one in effect.coefficients} | {one.symbol for one in effect.signals}
    for what in ("force", "sense"):
        laws = tuple(getattr(effect, what))
        if len(laws) != 2:
            raise ModelError(f"{what}: expected two expressions, one per axis, not {len(laws)}")
        if strange := sorted(map(str, _symbols(sp, laws) - declared)):
            raise ModelError(f"{what}: {strange[0]} is no state, drive, coefficient or signal; declare it")


def _symbols(sp: Any, laws: Iterable[Any]) -> set[Any]:
    return set().union(*(sp.sympify(law).free_symbols for law in laws))


def _package(entry: EntryPoint) -> str:
    return f"package {entry.dist.name} {entry.dist.version}" if entry.dist is not None else f"module {entry.module}"
