"""``hil diff``: two runs, or two traces, side by side."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import hil
from hil.cli.options import Json

if TYPE_CHECKING:
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
    from hil.cli.output import Output

    output = Output()
    for letter, place, verdict in (("A", found.a, found.verdict_a), ("B", found.b, found.verdict_b)):
        output.say(f"{letter}  {place}  {verdict or 'no verdict'}")
    if found.same_record:
        output.say("one record: an uncertainty is the most it can be")
    output.say()
    figures = map(_readable, found.figures)
    rows = [(one.name, *_cells(one), one.unit, "apart" if one.apart else "") for one in figures]
    output.table(("", "A", "B", "B − A", "", ""), rows, right=(1, 2, 3))
    output.say()
    output.say("bench files" if found.bench else "bench files: the same")
    for key in found.bench:
        output.say(f"  {key.name}: {_value(key.a)} → {_value(key.b)}")


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
    from hil.toml.reading import toml_value

    return "not given" if value is None else toml_value(value)
