"""``hil demo``: the whole bench in one command."""

from typing import Annotated

import typer

from hil.cli.options import RUNS, Duration, Json, Name, Out, Seed

GainMode = Annotated[
    bool,
    typer.Option("--gain-mode", help="A 5 kHz gyro at 100 kS/s; its board closes the loop with the host's matrix."),
]


def demo(
    out: Out = RUNS,
    name: Name = None,
    duration: Duration = None,
    seed: Seed = None,
    gain_mode: GainMode = False,
    json: Json = False,
) -> None:
    """Close the loop with an emulated board in real time.

    Starts the board S-slow as a process of its own on a pty, runs observer and controller against it, scores
    the estimates against the board's truth, writes a report and prints the figures. Needs no hardware.

    With --gain-mode the board is S-modern at 5 kHz, too fast for an answer to every sample: the host observes blocks
    of samples and sends the board the matrix to close the loop with.

    Examples:

    \b
      hil demo
      hil demo --duration 20 --name first
      hil demo --gain-mode
      hil demo --json > demo.json
    """
    from hil import demo as showcase
    from hil.cli.progress import watching
    from hil.cli.show import finish

    with watching("demo") as watch:
        folder = showcase.demo(
            out, name=name or "demo", duration_s=duration, seed=seed, gain_mode=gain_mode, progress=watch
        )
    finish(folder, as_json=json)
