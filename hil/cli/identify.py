"""``hil identify``: a bench file from an experiment with the board."""

from pathlib import Path
from typing import Annotated, NoReturn, Unpack

import typer

from hil.cli.options import RUNS, Json, with_options
from hil.identifying.options import LocalIdentifyOptions

BoardLink = Annotated[
    str | None,
    typer.Argument(metavar="LINK", help="serial:PORT, can:NAME, udp:GROUP:PORT, pty:SCENARIO or inproc:SCENARIO."),
]
BenchOut = Annotated[Path | None, typer.Option("--out", "-o", help="Bench file to write.  [default: my.bench.toml]")]
Folder = Annotated[Path, typer.Option("--runs", help="Folder for records and page.")]
Arm = Annotated[bool, typer.Option("--arm", help="Consent to arming the board; emulated ones started here need none.")]

Accept = Annotated[
    bool, typer.Option("--accept", help="Test the board against every rule of the wire instead of the experiment.")
]


@with_options(LocalIdentifyOptions)
def identify(
    link: BoardLink = None,
    out: BenchOut = None,
    runs: Folder = RUNS,
    arm: Arm = False,
    accept: Accept = False,
    json: Json = False,
    **options: Unpack[LocalIdentifyOptions],
) -> None:
    """Find a board's constants by an experiment, and write its bench file.

    The experiment: the board at rest, a sweep over all frequencies, then bursts and a random drive about the
    resonances, with free decays between. Keep the board still. The drive stops where the sense voltage reaches its
    limit. At every end the host sends SAFE, as in hil run. The file has a value and an uncertainty for every key that
    a record determines; the others are marked. report.html has Bode and ring-down plots, and the proposed settings
    with the noise, bandwidth and margin that they reach.

    If the board differs from its IDENTITY (latency, signs, scales, bits, channels), the difference is named and no
    file is written: exit code 1. --like also compares scales and both signs with a bench file.

    --accept tests the board against every rule of docs/wire.md and docs/safety.md: conversation, order, loss, limits,
    watchdog, stops. Exit code 1: a rule is broken.

    Examples:

    \b
      hil identify inproc:s-still -o my.bench.toml --mass 5e-7
      hil identify serial:/dev/ttyACM0 -o my.bench.toml --arm --sense-limit 0.5 --mass 1e-8
      hil identify serial:/dev/ttyACM0 --like data-sheet.bench.toml --arm
      hil identify serial:/dev/ttyACM0 --accept --arm
      hil identify --record runs/20260101-120000-identify/20260101-120003-measure -o again.bench.toml
    """
    from shlex import quote

    from hil.cli import consent
    from hil.cli.progress import watching
    from hil.cli.show import print_json, say
    from hil.errors.ending import ExitCode
    from hil.identifying.findings import CALLED
    from hil.identifying.identify import identify as carry_out
    from hil.identifying.request import request_of, told
    from hil.numbers import counted, plus_minus

    if accept:
        _accept(link, runs, arm=arm, as_json=json)
    request = request_of(link, Path("my.bench.toml") if out is None else out, options)
    if not request.emulated:
        assert request.link is not None
        consent.require_words(request.link, told(request), given=arm)
    with watching(request.name) as watch:
        done = carry_out(request, runs, watch)
    found = done.findings
    if json:
        print_json(
            {**found.as_json(), "bench": None if done.bench is None else str(done.bench), "folder": str(done.folder)}
        )
    else:
        print("Measured (± 95 %):")
        for name in ("resonance_1", "resonance_2", "q_1", "q_2", "azimuth", "gain_x", "gain_y", "delay"):
            one = found.constants[name]
            unit = "" if one.unit == "1" else f" {one.unit}"
            print(f"  {CALLED[name]:<28} {plus_minus(one.value, 2.0 * one.u)}{unit}")
        latency = f"{counted(found.latency_ticks, 'tick')}; IDENTITY says {found.identity.latency_ticks}"
        print(f"  {'latency':<28} {latency}")
        if found.advice is not None:
            print("Predicted for the proposed settings:", *found.advice.sentences, sep="\n  ")
    for line in () if found.advice is None else found.advice.missed:
        say(line)
    for line in (*found.remarks, *found.faults):
        say(line)
    say(f"{done.folder}: records and report.html" + ("" if done.bench is None else f"; {done.bench}: written"))
    if done.bench is not None and link is not None:
        at = "" if request.kept_link else f" --link {quote(link)}"
        say(f"next: hil run {quote(str(done.bench))}{at}")
    raise typer.Exit(ExitCode.GOOD if done.good else ExitCode.AGAINST)


def _accept(link: str | None, runs: Path, *, arm: bool, as_json: bool) -> NoReturn:
    from hil.boards.emulation import is_emulated, located
    from hil.cli import consent
    from hil.cli.progress import watching
    from hil.cli.show import print_json, say
    from hil.errors import InputError, printable
    from hil.errors.ending import ExitCode
    from hil.testing.acceptance import WORDS, accept

    if link is None:
        raise InputError("--accept: give the link of a board")
    place = located(link)
    if not is_emulated(place):
        consent.require_words(place, WORDS, given=arm)
    with watching("accept") as watch:
        answers = accept(place, runs, watch)
    if as_json:
        print_json(answers.as_json())
    else:
        if answers.alarm:
            print(printable(f"UNSAFE: {answers.alarm}"))
        for rule, why in answers.broken.items():
            print(printable(f"not kept   {rule}: {why}"))
        for rule, why in answers.untried.items():
            print(printable(f"not asked  {rule}: {why}"))
        print(f"kept       {len(answers.kept)} of {len(answers.kept) + len(answers.broken)} rules")
    say(f"{answers.folder}/accept.html: written")
    raise typer.Exit(ExitCode.GOOD if answers.good else ExitCode.AGAINST)
