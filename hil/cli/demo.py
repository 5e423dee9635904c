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
    """Close the loop in real time, find what the model lacks, and close it again without that error.

    Starts the board S-undeclared, which has an effect the host is not told of, as a process of its own on a pty; runs
    observer and controller against it; traces the record; adds what it finds; runs again; scores both runs against the
    board's truth, and prints the figures of the second beside those of the first. Needs no hardware.

    With --gain-mode the board is S-modern at 5 kHz, too fast for an answer to every sample: the host observes blocks
    of samples and sends the board the matrix to close the loop with. That is one run, and nothing is hidden in it.

    Exit code 0: the last run's verdict is good; 1: it is not. A machine that is too busy is a reason as well: it stands
    in the machine's part of the verdict and says nothing about the model.

    Examples:

    \b
      hil demo
      hil demo --duration 20 --name first
      hil demo --gain-mode
      hil demo --json > demo.json
    """
    from hil import demo as showcase
    from hil.cli.progress import watching
    from hil.cli.show import finish, print_before_and_after

    called = name or "demo"
    with watching("demo") as watch:
        if gain_mode:
            folder = showcase.in_gain_mode(out, name=called, duration_s=duration, seed=seed, progress=watch)
        else:
            circle = showcase.demo(out, name=called, duration_s=duration, seed=seed, progress=watch)
            folder = circle.after or circle.before
    if not (gain_mode or json):
        print_before_and_after(circle)
    finish(folder, as_json=json)
