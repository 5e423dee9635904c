"""``hil emulate``: serve an emulated board until told to stop."""

from typing import Annotated

import typer

from hil.cli.options import Json, Seed, Truth

ScenarioArgument = Annotated[
    str, typer.Argument(metavar="SCENARIO", help="Scenario file, or the name of an example (s-slow).")
]
BoardLink = Annotated[
    str, typer.Option("--link", "-l", help="What the board is to be reached by: pty, can:NAME or udp:GROUP:PORT.")
]


def emulate(
    scenario: ScenarioArgument,
    link: BoardLink = "pty",
    truth: Truth = None,
    seed: Seed = None,
    json: Json = False,
) -> None:
    """Serve an emulated board until told to stop.

    Prints one line, `ready serial:/dev/pts/N` or `ready` with the link given, when it can be connected to. Ends with
    Ctrl-C or SIGTERM, or when a lockstep host hangs up.

    Examples:

    \b
      hil emulate s-slow
      hil emulate my.scenario.toml --truth truth.arrow --seed 7
      hil run s-slow --link serial:/dev/pts/N --arm       (in a second terminal)
      hil emulate s-slow --link can:vcan0
      hil emulate s-slow --link udp:239.0.0.1:4242
      hil emulate s-slow --link "udp:239.0.0.1:4242?interface=192.168.1.30&key=gyro-7.key"
    """
    from json import dumps

    from hil.emulation import emulator
    from hil.examples import find

    with emulator(find("scenario", scenario), link=link, truth=truth, seed=seed) as board:
        print(dumps({"ready": board.url}) if json else f"ready {board.url}", flush=True)
        board.wait()
