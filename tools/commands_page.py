"""The overview of the commands, from what each says of itself."""

import inspect
from collections.abc import Iterator
from typing import Any

import typer

from hil.cli.app import app
from tools.markdown import table


def commands() -> str:
    """Each command with its arguments, and the first paragraph of its help."""
    group: Any = typer.main.get_command(app)
    rows = ((f"`{' '.join(('hil', name, *_arguments(one)))}`", _does(one)) for name, one in group.commands.items())
    return table(("command", "does"), rows)


def _arguments(command: Any) -> Iterator[str]:
    for one in command.params:
        if one.param_type_name == "argument":
            name = one.metavar or one.name.upper()
            name = name if one.nargs == 1 or "…" in name else f"{name}…"
            yield name if one.required else f"[{name.strip('[]')}]"


def _does(command: Any) -> str:
    return " ".join(inspect.cleandoc(command.help).partition("\n\n")[0].split())
