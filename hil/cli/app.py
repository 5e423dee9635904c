"""The table of verbs."""

from collections.abc import Callable
from functools import wraps
from typing import Annotated, Any

import typer

from hil.cli.characterise import characterise
from hil.cli.check import check
from hil.cli.compare import compare
from hil.cli.demo import demo
from hil.cli.diff import diff
from hil.cli.doctor import doctor
from hil.cli.emulate import emulate
from hil.cli.export import export
from hil.cli.generate import generate
from hil.cli.identify import identify
from hil.cli.import_ import import_
from hil.cli.init import init
from hil.cli.key import key
from hil.cli.record import record
from hil.cli.replay import replay
from hil.cli.run import run
from hil.cli.runs import ls, show
from hil.cli.score import score
from hil.cli.serve import serve
from hil.cli.sweep import sweep
from hil.cli.top import top
from hil.cli.trace import trace


class Stopped(Exception):
    """A verb that was interrupted, with the words of its interruption: typer forgets those of a KeyboardInterrupt."""


def telling(verb: Callable[..., None]) -> Callable[..., None]:
    """The verb, which raises Stopped where it is interrupted."""

    @wraps(verb)
    def told(*args: Any, **options: Any) -> None:
        try:
            verb(*args, **options)
        except KeyboardInterrupt as interruption:
            raise Stopped(str(interruption)) from None

    return told


def _version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        print(f"gyrohil {version('gyrohil')}")
        raise typer.Exit


def _hil(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """What stands before a verb."""


app = typer.Typer(
    callback=_hil,
    help="Hardware-in-the-loop bench for angle-measuring gyros: close the loop with a board, real or "
    "emulated, record everything, and judge the angle.",
    epilog="Start with: hil demo. Exit codes: 0 good, 1 the verdict is not good, 2 bad input, 3 a fault of the "
    "program, 130 interrupted.",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # plain text: [link] is a table of a file here, not a style
    context_settings={"help_option_names": ["-h", "--help"]},
)
VERBS = (
    demo, run, record, emulate, doctor, init, identify, replay, trace, score, characterise, compare, sweep, ls, show,
    diff, check, import_, export, generate, key, serve, top,
)  # fmt: skip
for verb in VERBS:
    app.command(verb.__name__.rstrip("_"))(telling(verb))
