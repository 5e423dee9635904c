"""``hil run``: the loop against a board, real or emulated."""

from typing import TYPE_CHECKING, Annotated, Unpack

import typer

from hil.cli.derived import with_options
from hil.cli.options import RUNS, BenchArgument, Json, Link, Out
from hil.loop.options import LocalRunOptions

if TYPE_CHECKING:
    from hil.bench import Bench

Arm = Annotated[bool, typer.Option("--arm", help="Consent to arming the board; emulated ones started here need none.")]
DryRun = Annotated[
    bool,
    typer.Option(
        "--dry-run",
        help="Connect, write the registers and read them back, compare board and bench file; show what follows from "
        "the bench file (resonance, Q, split, drive needed) and warn about improbable values; do not arm.",
    ),
]
Live = Annotated[bool, typer.Option("--live", help="Serve the run's page during the run, and open it.")]


@with_options(LocalRunOptions)
def run(
    bench: BenchArgument,
    link: Link = None,
    out: Out = RUNS,
    arm: Arm = False,
    dry_run: DryRun = False,
    live: Live = False,
    json: Json = False,
    **options: Unpack[LocalRunOptions],
) -> None:
    """Connect to a board, arm it, close the loop, record, and report.

    Without --link the bench file's [link] url is used. pty:SCENARIO and inproc:SCENARIO start an emulated
    board. Any other link may drive real hardware: the board is armed only with --arm, or after a yes at the
    terminal. At every end of a run the host sends SAFE, and the board has to confirm it (docs/safety.md).

    A dry run on wall time also measures how fast this machine answers on that link. For an emulated board it shows the
    latency, or the block and sample rate, at which the late answers stay within the limit. For any other board it
    shows the table of hil doctor, without arming.

    Examples:

    \b
      hil run s-slow
      hil run s-slow --link inproc:s-slow --clock lockstep --duration 20
      hil run my.bench.toml --link serial:/dev/ttyACM0 --dry-run
      hil run my.bench.toml --link can:can0 --arm --wire-log bus.blf
      hil run my.bench.toml --link serial:/dev/ttyACM0 --arm --note "after rework"
      hil run s-slow --duration 600 --live
    """
    from hil.cli import consent
    from hil.cli.own import prepare
    from hil.cli.progress import watching
    from hil.cli.show import finish, question, show_identity
    from hil.errors import InputError
    from hil.loop.request import request_of

    if live and dry_run:
        raise InputError("--live: without --dry-run, which records nothing to look at; leave one out")
    request = request_of(bench, options, link=link, dry_run=dry_run)
    declared, url = request.bench, request.link
    if not dry_run:
        question(declared)
    if not dry_run and not request.emulated:
        consent.require(url, declared, given=arm)
    prepare(declared)
    with watching(declared.loop.name) as watch:
        if live:
            from hil.cli.run_live import run_live

            finish(run_live(request, options, out, watch), as_json=json)
        from hil.loop.run import run as run_loop

        done = run_loop(request, out, progress=watch)
    if done.folder is not None:
        finish(done.folder, as_json=json)
    show_identity(url, done.identity, declared, as_json=json)
    if not json and declared.loop.clock != "lockstep":
        _show_what_is_held(declared, url)


def _show_what_is_held(bench: "Bench", url: str) -> None:
    """After a dry run: what the run may ask of this machine."""
    from hil.boards.emulation import is_emulated
    from hil.cli.doctor import print_holds
    from hil.cli.progress import watching
    from hil.doctor import link
    from hil.doctor.started import measured
    from hil.errors import printable

    if is_emulated(url):
        with watching("what this machine holds") as watch:
            found = measured(bench, url, watch, becomes="would be started")
            print(printable(f"machine    {found.words}"))
        return
    _, there = link.examine(url)
    if there is not None:
        print_holds(there["holds"])
