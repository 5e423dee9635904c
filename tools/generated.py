"""All files that are made of declarations: what each has to hold, given what it holds now."""

from collections.abc import Callable, Mapping
from functools import partial

from tools import (
    bench_page,
    c_header,
    campaign_page,
    commands_page,
    dbc,
    effects_page,
    golden,
    gyros_page,
    hidden_effects_page,
    library_page,
    maps_page,
    requests_page,
    scenario_page,
    schemas,
    wire_page,
)
from tools.markdown import filled

Parts = Mapping[str, Callable[[], str]]

PAGES: dict[str, Parts] = {
    "docs/reference/bench.md": bench_page.PARTS,
    "docs/reference/campaigns.md": {"keys": campaign_page.keys},
    "docs/reference/cli.md": {"commands": commands_page.commands},
    "docs/reference/effects.md": {"entries": effects_page.entries},
    "docs/reference/errors.md": {"endings": requests_page.endings},
    "docs/reference/hidden-effects.md": {"effects": hidden_effects_page.effects},
    "docs/reference/library.md": {"signatures": library_page.signatures},
    "docs/reference/maps.md": maps_page.PARTS,
    "docs/reference/requests.md": {"requests": requests_page.requests},
    "docs/reference/scenario.md": scenario_page.PARTS,
    "docs/safety.md": {"state_table": wire_page.state_table},
    "docs/wire.md": wire_page.PARTS,
}
"""Parts of each page, by the names between its marks."""

WHOLE: dict[str, Callable[[], str]] = {
    **{
        f"docs/reference/{name}.schema.json": partial(schemas.schema_of, model)
        for name, model in schemas.PUBLISHED.items()
    },
    "docs/reference/gyros.md": gyros_page.page,
    "docs/reference/field-table.tsv": wire_page.field_table,
    "firmware/gyrohil.dbc": dbc.render,
    "firmware/src/hil_spec.c": c_header.source,
    "firmware/src/hil_spec.h": c_header.header,
    "tests/wire/golden.json": golden.render,
}
"""Files that nobody writes by hand."""

SAID = {"docs/reference/bench.md": bench_page.said, "docs/wire.md": wire_page.said}
"""What stands in the text of a page with numbers of the program."""


def text_of(name: str, now: str) -> str:
    """What the file has to hold."""
    return WHOLE[name]() if name in WHOLE else filled(now, PAGES[name])
