"""Two runs, or two traces, side by side: all their figures from the catalogue, and the keys of their bench files."""

from typing import Any

from hil.comparing.diff import Figure, keys_apart, same_record
from hil.errors import InputError
from hil.records.runfolder import RunFolder
from hil.service import series
from hil.service.catalogue.catalogue import Catalogue
from hil.service.catalogue.queries import figures_of, key_of


def compare(catalogue: Catalogue, a: str, b: str) -> dict[str, Any]:
    """Figures with difference b − a, its uncertainty (95 %) and which of the two is better; the channels that both
    have; the bench keys that differ. Raises Unknown for an unknown run, InputError for two of different kinds.
    """
    database = catalogue.database
    keys = [key_of(catalogue, run) for run in (a, b)]
    kinds = [database.execute("SELECT kind FROM runs WHERE key = ?", (key,)).fetchone()[0] for key in keys]
    if kinds[0] != kinds[1]:
        raise InputError(f"{a} is a {kinds[0]}, {b} a {kinds[1]}; compare two runs, or two traces")
    folders = [catalogue.path_of(run) for run in (a, b)]
    same = kinds[0] == "run" and same_record(*(folder / "capture.arrow" for folder in folders))
    first, second = (figures_of(database, key) for key in keys)
    figures = [
        _side_by_side(name, first.get(name), second.get(name), same) for name in dict.fromkeys([*first, *second])
    ]
    told = [{one.name: None for one in series.channels(folder)} for folder in folders]
    benches = [RunFolder(folder).bench for folder in folders]
    return {
        "a": a,
        "b": b,
        "kind": kinds[0],
        "same_record": same,
        "figures": figures,
        "channels": [name for name in told[0] if name in told[1]],
        "bench": [key.as_json() for key in keys_apart(*benches)],
    }


def _side_by_side(name: str, a: dict[str, Any] | None, b: dict[str, Any] | None, same: bool) -> dict[str, Any]:
    known = a or b or {}
    alike = a is None or b is None or a["unit"] == b["unit"]
    one = Figure(
        name, known["unit"], a["value"] if a else None, b["value"] if b and alike else None,
        a["u"] if a else None, b["u"] if b and alike else None, same,
    )  # fmt: skip
    return {
        "name": name,
        "unit": one.unit,
        "a": one.a,
        "b": one.b,
        "u_a": one.u_a,
        "u_b": one.u_b,
        "difference": one.difference,
        "uncertainty": one.uncertainty,
        "apart": one.apart,
        "better": _better(one, known["better"]),
    }


def _better(one: Figure, rule: str | None) -> str | None:
    """`a` or `b`; None where neither is, or where nobody can say."""
    if rule is None or one.a is None or one.b is None or one.a == one.b or one.apart is False:
        return None
    badness = [{"less": value, "more": -value, "one": abs(value - 1.0)}[rule] for value in (one.a, one.b)]
    if badness[0] == badness[1]:
        return None
    return "a" if badness[0] < badness[1] else "b"
