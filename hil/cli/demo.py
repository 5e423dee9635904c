"""``hil demo``: the whole bench in one command."""

from hil.cli.options import RUNS, Duration, Json, Name, Out, Seed


def demo(out: Out = RUNS, name: Name = None, duration: Duration = None, seed: Seed = None, json: Json = False) -> None:
    """Close the loop with an emulated board in real time.

    Starts the board S-slow as a process of its own on a pty, runs observer and controller against it, scores
    the estimates against the board's truth, writes a report and prints the figures. Needs no hardware.

    Examples:

    \b
      hil demo
      hil demo --duration 20 --name first
      hil demo --json > demo.json
    """
    from hil import demo as showcase
    from hil.cli.progress import watching
    from hil.cli.show import finish

    with watching("demo") as watch:
        folder = showcase.demo(out, name=name or "demo", duration_s=duration, seed=seed, progress=watch)
    finish(folder, as_json=json)
