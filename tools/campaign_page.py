"""Tables of the reference page of campaigns."""

from collections.abc import Iterator

from pydantic import BaseModel

from hil.sweeping.campaign import Campaign, Design, Each, Report, Run, Trace, Vary
from hil.sweeping.columns import FIGURES, IDENTITY
from hil.sweeping.instrument import Instrument
from tools.markdown import keys_table, table

_TABLES: dict[str, type[BaseModel]] = {
    "[design]": Design,
    "[[vary]]": Vary,
    "[each]": Each,
    "[run]": Run,
    "[trace]": Trace,
    "[report]": Report,
    "[table], [chamber]": Instrument,
}


def keys() -> str:
    """The keys of each table of a campaign file."""
    own = ("design", "vary", "each", "run", "trace", "report", "table", "chamber")
    parts = [f"### At the top\n\n{keys_table(Campaign, skip=own)}"]
    parts += [f"### `{name}`\n\n{keys_table(model)}" for name, model in _TABLES.items()]
    return "\n\n".join([*parts, f"### Columns of the results\n\n{table(('column', 'type', 'meaning'), _columns())}"])


def _columns() -> Iterator[tuple[str, ...]]:
    for name, (kind, what) in {**IDENTITY, **FIGURES}.items():
        yield f"`{name}`", kind, what
    yield "`error_STATE`, `sd_STATE`", "float64", "at the last instant: estimate less truth, its stated deviation"
