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
    """Close the loop in real time, find what the model lacks, and close the loop again with it.

    Starts the board S-undeclared as a separate process on a pty; it has an effect that the host does not know. Runs
    observer and controller on it, traces the record, adds the effect found, and runs again. Scores both runs with the
    board's truth, and prints the figures of both side by side. Needs no hardware.

    With --gain-mode the board is S-modern at 5 kHz, too fast for an answer to every sample. The host observes blocks
    of samples and sends the board the matrix that closes the loop. This is one run, without a hidden effect.

    First the demo measures for 1.5 s how late answers are on this machine, with the same link and processes. It starts
    the emulated board with the smallest latency (with --gain-mode the block and sample rate) at which the late answers
    stay within the limit. A line says what was measured and chosen. If a run still has too many late answers, it is
    repeated once with the next setting. If no setting is slow enough, the run is in lockstep.

    Exit code 0: every result under test was shown, one line each; 1: one was not. Late answers do not count: they are
    in the part `machine` of the verdict.

    Examples:

    \b
      hil demo
      hil demo --duration 20 --name first
      hil demo --gain-mode
      hil demo --json > demo.json
    """
    from hil import demo as showcase
    from hil.cli.progress import watching
    from hil.cli.show import finish, print_before_and_after, print_under_test

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
        print_under_test(shown)
    finish(shown.last, as_json=json, good=all(one.held for one in shown.under_test), told=shown.told)
