"""Tables of the reference page of bench files."""

from collections.abc import Iterable

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from estimator.custom.grammar import DEEPEST, FUNCTIONS, LARGEST_EXPONENT, LONGEST
from estimator.custom.names import QUANTITIES
from hil.bench.bench import Bench
from hil.bench.by_verb import NOT_OF
from hil.bench.device import Device
from hil.bench.effects import OwnCoefficient, OwnEffect, OwnParameter
from hil.bench.rate_sensor import RateSensorBench
from hil.bench.section import FIELD_UNITS, other_keys
from hil.bench.template import keys, meaning, others, sections
from tools.markdown import keys_table, kind_of, table

_OWN = (
    ("effects.custom.NAME", OwnEffect),
    ("effects.custom.NAME.coefficients.SYMBOL", OwnCoefficient),
    ("effects.custom.NAME.parameters.SYMBOL", OwnParameter),
)


def said() -> Iterable[str]:
    """What bench.md says with numbers of the program in it."""
    yield f"at most {LONGEST} characters and {DEEPEST} levels of nesting;"
    yield f"exponents are numbers up to {LARGEST_EXPONENT}."
    yield f"the functions {', '.join(f'`{name}`' for name in FUNCTIONS)} of one argument."


def units() -> str:
    """Keys in units that are usual for gyros."""
    rows = ((f"`…{one.end}`", f"`…{one.other}`", one.symbol) for one in FIELD_UNITS)
    return table(("instead of", "you may write", "unit"), rows)


def modes() -> str:
    """Keys in place of stiffness and damping."""
    schema = Device.model_json_schema(ref_template="{model}")["properties"]
    return table(
        ("key", "value", "meaning"), ((f"`{key}`", kind_of(schema[key]), told) for key, told in others(Device))
    )


def names() -> str:
    """What a law of one's own may name."""
    return table(
        ("name", "unit", "what it is"), ((f"`{name}`", one.unit, one.meaning) for name, one in QUANTITIES.items())
    )


def by_verb() -> str:
    """Keys that a command does not use, by the reason."""
    reasons: dict[str, dict[str, list[str]]] = {}
    for verb, unused in NOT_OF.items():
        for key, why in unused.items():
            reasons.setdefault(why, {}).setdefault(verb, []).append(f"`{key}`")
    rows: dict[tuple[str, str], list[str]] = {}
    for why, of_verbs in reasons.items():
        for of, each in of_verbs.items():
            rows.setdefault((why, ", ".join(each)), []).append(f"`hil {of}`")
    shown = ((why, ", ".join(verbs), keys) for (why, keys), verbs in rows.items())
    return table(("because", "command", "keys"), shown)


def _tables(listed: Iterable[tuple[str, type[BaseModel]]]) -> str:
    return "\n\n".join(
        f"## [{path}]\n\n{' '.join((model.__doc__ or '').split())}\n\n{_keys(model)}" for path, model in listed
    )


def _keys(model: type[BaseModel]) -> str:
    def told(key: str, field: FieldInfo) -> str:
        return meaning(field) + "".join(f"; or `{other.name}` in {other.symbol}" for other in other_keys(key))

    return keys_table(model, told, only=[key for key, _ in keys(model)])


PARTS = {
    "units": units,
    "device": lambda: _tables((path, model) for path, model in sections(Bench) if model is Device),
    "modes": modes,
    "sections": lambda: _tables((path, model) for path, model in sections(Bench) if model is not Device),
    "effects": lambda: meaning(Bench.model_fields["effects"]),
    "own": lambda: _tables(_OWN),
    "names": names,
    "by_verb": by_verb,
    "sensor": lambda: _tables(sections(RateSensorBench)),
}
