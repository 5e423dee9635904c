"""Tables of the reference page of scenario files."""

from typing import Annotated, get_args, get_origin

from pydantic.fields import FieldInfo

from device_emulator.faults import Faults, Saturated, Spell, Stuck
from device_emulator.modes import KEYS
from device_emulator.scenario import Board, Drive, Scenario, Truth
from device_emulator.section import Section, both_axes
from device_emulator.temperature import Temperature
from device_emulator.trim import Trim
from hil.bench.template import meaning
from tools.markdown import keys_table, kind_of, table


def _part(section: type[Section]) -> str:
    """What the section says of itself, and its keys."""
    text = " ".join((section.__doc__ or "").split())
    told = text.partition("`: ")[2] or text
    return f"{told[:1].upper()}{told[1:]}\n\n{_keys(section)}"


def _keys(section: type[Section], only: tuple[str, ...] | None = None) -> str:
    others = {field: other for other, field in section.other_keys().items()}
    schemas = section.model_json_schema(ref_template="{model}")["properties"]

    def told(key: str, field: FieldInfo) -> str:
        return meaning(field) + (f"; or `{others[key]}`" if key in others else "")

    either = {
        key: kind_of({"anyOf": schemas[key]["prefixItems"][:1]}).replace("number", "number or [x, y]")
        for key, field in section.model_fields.items()
        if any(getattr(rule, "func", None) is both_axes for rule in field.metadata)
    }
    return keys_table(section, told, only=only, skip=("kind",), kinds=either)


def _kinds(key: str, heading: str) -> str:
    """Each of the sections that a table may be, by its `kind`, as the declaration of the file has them."""
    parts = []
    for one in get_args(Scenario.model_fields[key].annotation):
        section = get_args(one)[0] if get_origin(one) is Annotated else one
        (kind,) = get_args(section.model_fields["kind"].annotation)
        parts.append(f'{heading}kind = "{kind}"\n\n{_part(section)}')
    return "\n\n".join(parts)


PARTS = {
    "senses": lambda: _kinds("sense", "## [sense], "),
    "rates": lambda: _kinds("rate", "### "),
    "top": lambda: _keys(Scenario, only=("seed",)),
    "modes": lambda: table(("key", "meaning"), ((f"`{key}`", told) for key, told in KEYS.items())),
    **{
        name: lambda section=section: _part(section)  # type: ignore[misc]
        for name, section in {
            "truth": Truth, "drive": Drive, "board": Board,
            "temperature": Temperature, "trim": Trim, "faults": Faults,
            "spells": Spell, "stuck": Stuck, "saturated": Saturated,
        }.items()
    },
}  # fmt: skip
