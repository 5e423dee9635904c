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

    What this machine holds is measured first, for a second and a half, on the same link with the same processes. By
    that the emulated board is started with the smallest latency (with --gain-mode the block and sample rate) at which
    few enough answers are late. A line says what was measured and chosen. A run that is late all the same is repeated
    once with the next choice. Where no choice holds the run is in lockstep.

    Exit code 0: everything claimed was shown, each claim has a line; 1: it was not. Late answers are no claim: they
    stand in the machine's part of the verdict.

    Examples:

    \b
      hil demo
      hil demo --duration 20 --name first
      hil demo --gain-mode
      hil demo --json > demo.json
    """
    from hil import demo as showcase
    from hil.cli.progress import watching
    from hil.cli.show import finish, print_before_and_after, print_claims

    called = name or "demo"
    shown: showcase.Circle | showcase.Single
    with watching("demo") as watch:
        if gain_mode:
            shown = showcase.in_gain_mode(out, name=called, duration_s=duration, seed=seed, progress=watch)
        else:
            shown = showcase.demo(out, name=called, duration_s=duration, seed=seed, progress=watch)
    if not json:
        if isinstance(shown, showcase.Circle):
            print_before_and_after(shown)
        print_claims(shown)
    finish(shown.last, as_json=json, good=all(claim.held for claim in shown.claims))
