"""The campaign file described: its JSON Schema, and the tables of its page of the reference.

``python -m hil.sweeping.text docs/reference`` writes ``campaign.schema.json`` and the tables of ``campaigns.md``, which
stand between its two marks.
"""

import json
import sys
from collections.abc import Iterator
from pathlib import Path

from pydantic import BaseModel

from hil.bench.text import meaning
from hil.records.atomic import write_text
from hil.sweeping.campaign import Campaign, Design, Each, Report, Run, Trace, Vary
from hil.sweeping.figures import FIGURES, IDENTITY

BEGIN, END = "<!-- generated: keys -->\n", "<!-- end -->\n"
_TABLES: dict[str, type[BaseModel]] = {
    "": Campaign,
    "[design]": Design,
    "[[vary]]": Vary,
    "[each]": Each,
    "[run]": Run,
    "[trace]": Trace,
    "[report]": Report,
}
_WORDS = {
    "number": "number", "integer": "whole number", "string": "text", "boolean": "true, false", "array": "list",
    "object": "table",
}  # fmt: skip


def json_schema() -> str:
    """The published JSON Schema (draft 2020-12) as text."""
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", **Campaign.model_json_schema()}
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


def reference(page: str) -> str:
    """`page` with its tables as the program has them."""
    before, rest = page.split(BEGIN)
    after = rest.split(END, 1)[1]
    return f"{before}{BEGIN}{''.join(_tables())}{END}{after}"


def _tables() -> Iterator[str]:
    for name, model in _TABLES.items():
        yield f"\n### {f'`{name}`' if name else 'At the top'}\n\n"
        yield "| key | value | default | meaning |\n|---|---|---|---|\n"
        properties = model.model_json_schema(ref_template="{model}")["properties"]
        for key, field in model.model_fields.items():
            schema = properties[key]
            if "$ref" in schema or schema.get("items", {}).get("$ref"):
                continue
            options = [one for one in schema.get("anyOf", [schema]) if one.get("type") != "null"]
            choices = options[0].get("enum")
            kind = " · ".join(f"`{one}`" for one in choices) if choices else _WORDS[options[0]["type"]]
            default = "**required**" if field.is_required() else _shown(field.default)
            yield f"| `{key}` | {kind} | {default} | {meaning(field)} |\n"
    yield "\n### Columns of the results\n\n| column | type | meaning |\n|---|---|---|\n"
    yield from (f"| `{name}` | {kind} | {what} |\n" for name, (kind, what) in {**IDENTITY, **FIGURES}.items())
    yield "| `error_STATE`, `sd_STATE` | float64 | at the last instant: estimate less truth, its stated deviation |\n"


def _shown(default: object) -> str:
    plain = isinstance(default, int | float | str)
    return f"`{json.dumps(default)}`" if plain else "–"


def main(folder: Path) -> None:
    """Write both files."""
    write_text(folder / "campaign.schema.json", json_schema())
    page = folder / "campaigns.md"
    write_text(page, reference(page.read_text(encoding="utf-8")))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
