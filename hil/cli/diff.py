"""``hil diff``: two runs, or two traces, side by side."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import hil
from hil.cli.options import Json

if TYPE_CHECKING:
    from rich.table import Table

    from hil.comparing.diff import Comparison, Figure

First = Annotated[
    Path,
    typer.Argument(
        metavar="A", help="Folder or name of a run or a trace; `last` is the newest run, `last-trace` the newest trace."
    ),
]
Second = Annotated[Path, typer.Argument(metavar="B", help="Another of the same kind.")]


def diff(a: First, b: Second, json: Json = False) -> None:
    """Show two runs, or two traces, side by side.

    Shows the difference of each figure, B minus A, with its uncertainty (95 %) if it is known; `apart` marks a
    difference larger than that. Then it lists the keys of the bench files that differ. Exit code 0: the two
    could be compared.

    Examples:

    \b
      hil diff runs/20250314-092653-s-slow last
      hil diff runs/before-trace last-trace --json
    """
    from hil.cli.show import print_json

    found = hil.diff(a, b)
    if json:
        print_json(found.as_json())
    else:
        _print(found)


def _print(found: "Comparison") -> None:
    from rich.console import Console

    from hil.errors import printable

    console = Console(highlight=False, soft_wrap=True)
    for letter, place, verdict in (("A", found.a, found.verdict_a), ("B", found.b, found.verdict_b)):
        console.print(printable(f"{letter}  {place}  {verdict or 'no verdict'}"), markup=False)
    if found.same_record:
        console.print("one record: an uncertainty is the most it can be")
    console.print()
    console.print(_figures(found))
    console.print()
    if not found.bench:
        console.print("bench files: the same")
        return
    console.print("bench files")
    for key in found.bench:
        told = f"  {key.name}: {_value(key.a)} → {_value(key.b)}"
        console.print(printable(told), markup=False)


def _figures(found: "Comparison") -> "Table":
    from rich.table import Table
    from rich.text import Text

    from hil.errors import printable

    table = Table("", box=None, pad_edge=False, header_style="dim")
    for heading in ("A", "B", "B − A"):
        table.add_column(heading, justify="right")
    table.add_column("")
    table.add_column("", style="yellow")
    for one in map(_readable, found.figures):
        unit = Text(printable(one.unit))
        table.add_row(Text(printable(one.name)), *_cells(one), unit, "apart" if one.apart else "")
    return table


def _readable(one: "Figure") -> "Figure":
    """In a prefix or a power of ten of its unit, where the number by itself would be long."""
    from hil.numbers import PREFIXED, in_thousands, prefix_for

    size = max((abs(value) for value in (one.a, one.b) if value is not None), default=0.0)
    factor, prefix = prefix_for(size, most=0) if one.unit in PREFIXED else in_thousands(size)
    values = {name: getattr(one, name) for name in ("a", "b", "u_a", "u_b")}
    scaled: dict[str, Any] = {name: None if value is None else factor * value for name, value in values.items()}
    return replace(one, unit=(prefix + one.unit).strip(), **scaled)


def _cells(one: "Figure") -> tuple[str, str, str]:
    from hil.numbers import plus_minus, signed

    difference, u = one.difference, one.uncertainty
    if difference is None:
        told = ""
    elif u is None or u == 0.0:
        told = signed(difference) if difference else "0"
    else:
        told = plus_minus(difference, u)
    return _number(one.a), _number(one.b), told


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.7g}"


def _value(value: Any) -> str:
    from hil.bench.toml import toml_value

    return "not given" if value is None else toml_value(value)
