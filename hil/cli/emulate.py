"""``hil emulate``: serve an emulated board until told to stop."""

from typing import Annotated

import typer

from hil.cli.options import Json, Seed, Truth

ScenarioArgument = Annotated[
    str, typer.Argument(metavar="SCENARIO", help="Scenario file, or the name of an example (s-slow).")
]
BoardLink = Annotated[str, typer.Option("--link", "-l", help="Link of the board: pty, can:NAME or udp:GROUP:PORT.")]

Latency = Annotated[
    int | None,
    typer.Option(
        "--latency", min=0, max=64, metavar="TICKS",
        help="Ticks from a sample to the interval that its drive acts on.  [default: the scenario's]",
    ),
]  # fmt: skip
Rate = Annotated[
    float | None,
    typer.Option("--rate", metavar="HZ", help="Samples a second.  [default: the scenario's]"),
]


def emulate(
    scenario: ScenarioArgument,
    link: BoardLink = "pty",
    truth: Truth = None,
    seed: Seed = None,
    latency: Latency = None,
    rate: Rate = None,
    json: Json = False,
) -> None:
    """Serve an emulated board until told to stop.

    Prints one line, `ready serial:/dev/pts/N` or `ready` with the link given, when it can be connected to. Ends with
    Ctrl-C or SIGTERM, or when a lockstep host hangs up.

    --latency and --rate change the board and its IDENTITY; the device stays that of the scenario. If the host starts
    the board, give them in the link: pty:SCENARIO?latency=TICKS&rate=HZ. The host uses the values of IDENTITY, and
    refuses a bench file with another sample_rate_Hz. A SENSE message has as many samples as
    [loop] block of the bench file says.

    Examples:

    \b
      hil emulate s-slow
      hil emulate my.scenario.toml --truth truth.arrow --seed 7
      hil run s-slow --link serial:/dev/pts/N --arm       (in a second terminal)
      hil emulate s-slow --latency 4
      hil emulate s-slow --link can:vcan0
      hil emulate s-slow --link udp:239.0.0.1:4242
      hil emulate s-slow --link "udp:239.0.0.1:4242?interface=192.168.1.30&key=gyro-7.key"
    """
    from contextlib import ExitStack
    from json import dumps

    from hil.bench.examples import find
    from hil.boards.emulation import emulator
    from hil.cli.progress import watching
    from hil.cli.show import say

    with ExitStack() as held:
        with watching("emulate") as watch:
            serving = emulator(
                find("scenario", scenario), link=link, truth=truth, seed=seed, latency_ticks=latency, rate_Hz=rate,
                progress=watch,
            )  # fmt: skip
            board = held.enter_context(serving)
        print(dumps({"ready": board.url}) if json else f"ready {board.url}", flush=True)
        board.wait()
        say(f"emulated board: {board.last_words()}")
