"""``hil init``: a bench file to start from."""

from pathlib import Path
from typing import Annotated

import typer

from hil.cli.options import Json, Link, Replace

FromBoard = Annotated[bool, typer.Option("--from-board", help="Ask the board at --link for what it declares.")]
Like = Annotated[
    str | None,
    typer.Option("--like", help="Bench file or example that fills in what the board does not say."),
]
Target = Annotated[Path, typer.Option("--out", "-o", help="Bench file to write.")]


def init(
    from_board: FromBoard = False,
    link: Link = None,
    like: Like = None,
    out: Target = Path("my.bench.toml"),
    replace: Replace = False,
    json: Json = False,
) -> None:
    """Write a bench file to start from.

    Every key is there with its meaning, filled in as far as the board's IDENTITY goes: a board knows its
    converters, rate and delay. Mass, stiffness, damping, amplitude and sense gain come from the data sheet:
    take them from another bench file with --like, or fill in what is marked REQUIRED.

    Examples:

    \b
      hil init -o my.bench.toml
      hil init --from-board --link serial:/dev/ttyACM0
      hil init --from-board --link pty:s-slow --like s-slow
    """
    from hil.bench import load_bench
    from hil.bench.template import missing, template, values_of
    from hil.cli.files import fresh
    from hil.cli.show import print_json, say
    from hil.errors import InputError
    from hil.examples import find
    from hil.records.atomic import write_text

    if from_board != (link is not None):
        raise InputError("--from-board and --link belong together; give both or neither")
    fresh(out, replace=replace)
    known = {} if like is None else values_of(load_bench(find("bench", like)))
    heading = "A bench file to be filled in."
    if link is not None:
        from hil.declared import from_identity
        from hil.emulation import located

        heading, told = from_identity(located(link))
        for section, table in told.items():
            known.setdefault(section, {}).update(table)
        known.setdefault("link", {})["url"] = link
    write_text(out, template(known, heading))
    open_keys = missing(known)
    if json:
        print_json({"bench": str(out), "missing": open_keys})
    else:
        say(f"{out}: written" + (f"; still to be filled in: {', '.join(open_keys)}" if open_keys else ""))
