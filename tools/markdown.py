"""Tables of Markdown, those of a model's keys among them, and pages that have generated parts."""

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from hil.bench.template import meaning
from hil.toml.reading import toml_value

_PART = re.compile(r"<!-- generated: (\w+) -->\n.*?<!-- end -->", re.DOTALL)
_WORDS = {"number": "number", "integer": "whole number", "string": "text", "boolean": "true, false"}
_BOUNDS = (("exclusiveMinimum", ">"), ("minimum", "≥"), ("exclusiveMaximum", "<"), ("maximum", "≤"))


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table without a line feed at its end; a bar in a cell is none of the table's."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(str(cell).replace("|", "\\|") for cell in line) + " |" for line in lines)


def filled(page: str, parts: Mapping[str, Callable[[], str]]) -> str:
    """`page` with what stands between its marks made anew.  Raises KeyError for a mark that has no part here."""
    return _PART.sub(lambda mark: f"<!-- generated: {mark[1]} -->\n\n{parts[mark[1]]()}\n\n<!-- end -->", page)


def keys_table(model: type[BaseModel], told: Callable[[str, FieldInfo], str] | None = None, **chosen: Any) -> str:
    """The keys of a table of a file, with what each takes; `chosen` as in `rows_of_keys`."""
    return table(("key", "value", "default", "meaning"), rows_of_keys(model, told, **chosen))


def rows_of_keys(
    model: type[BaseModel],
    told: Callable[[str, FieldInfo], str] | None = None,
    *,
    only: Sequence[str] | None = None,
    skip: Sequence[str] = (),
    kinds: Mapping[str, str] | None = None,
) -> Iterator[tuple[str, ...]]:
    """Key, value, default and meaning of each key; `kinds`: the value's, where the schema does not say it."""
    schemas = model.model_json_schema(ref_template="{model}")["properties"]
    for key, field in model.model_fields.items():
        if (only is None or key in only) and key not in skip:
            name = field.alias or key
            kind = (kinds or {}).get(key) or kind_of(schemas[name])
            yield f"`{name}`", kind, default_of(field), told(key, field) if told else meaning(field)


def kind_of(schema: Mapping[str, Any]) -> str:
    """The sort of value a key takes, in a few words, from its JSON Schema."""
    choices = [one for one in schema.get("anyOf", schema.get("oneOf", [schema])) if one.get("type") != "null"]
    return " or ".join(dict.fromkeys(map(_one_kind, choices)))


def _one_kind(schema: Mapping[str, Any]) -> str:
    if "const" in schema or "enum" in schema:
        return " · ".join(f"`{toml_value(value)}`" for value in schema.get("enum", [schema.get("const")]))
    match schema.get("type"):
        case None:
            return "table"
        case "object":
            inner = schema.get("additionalProperties")
            return (
                "table"
                if not isinstance(inner, Mapping)
                else "tables"
                if "$ref" in inner
                else f"table of {_each(inner)}"
            )
        case "array" if "prefixItems" in schema:
            first = schema["prefixItems"][0]
            return f"{len(schema['prefixItems'])} {_WORDS[first['type']]}s {_limits(first)}".strip()
        case "array":
            inner = schema.get("items", {})
            return "tables" if "$ref" in inner else f"list of {_each(inner)}" if inner else "list"
        case word:
            return f"{_WORDS[word]} {_limits(schema)}".strip()


def _each(schema: Mapping[str, Any]) -> str:
    return f"{kind_of(schema)}s" if schema.get("type") in _WORDS else kind_of(schema)


def _limits(schema: Mapping[str, Any]) -> str:
    return ", ".join(f"{sign} {schema[word]:g}" for word, sign in _BOUNDS if word in schema)


def default_of(field: FieldInfo) -> str:
    """What a key has where it is left out."""
    if field.is_required():
        return "**required**"
    value = field.get_default(call_default_factory=True)
    if value is None or value in ({}, (), []) or isinstance(value, BaseModel):
        return "–"
    several = list(value) if isinstance(value, tuple) else [value]
    if len(set(several)) == 1:  # one number for all of them
        value = several[0]
    return "`infinite`" if value == math.inf else f"`{toml_value(value)}`"
