"""``hil run``: the loop against a board, real or emulated."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn, Unpack

import typer

from hil.cli.options import RUNS, Json, Out, with_options
from hil.running.options import LocalRunOptions

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
Benches = Annotated[
    list[str],
    typer.Argument(metavar="BENCH", help="Bench file, or the name of an example (s-slow); with --mount up to three."),
]
Links = Annotated[
    list[str] | None,
    typer.Option(
        "--link",
        "-l",
        help="Where the board is: serial:PORT, can:NAME, udp:GROUP:PORT, pty:SCENARIO or inproc:SCENARIO; with --mount "
        "one for each bench file.",
    ),
]
MountFile = Annotated[
    Path | None,
    typer.Option(
        "--mount", help="File with the directions of the gyros' sensitive axes: run all at once, as one body."
    ),
]
Live = Annotated[bool, typer.Option("--live", help="Serve the run's page during the run, and open it.")]


@with_options(LocalRunOptions)
def run(
    benches: Benches,
    link: Links = None,
    mount: MountFile = None,
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

    With --mount several gyros on one body run at once, each in a process of its own. A lost board, a stop, or Ctrl-C
    brings all to SAFE. Three give the attitude of the body as a quaternion with its uncertainty.

    Examples:

    \b
      hil run s-slow
      hil run s-slow --link inproc:s-slow --clock lockstep --duration 20
      hil run my.bench.toml --link serial:/dev/ttyACM0 --dry-run
      hil run my.bench.toml --link can:can0 --arm --wire-log bus.blf
      hil run my.bench.toml --link serial:/dev/ttyACM0 --arm --note "after rework"
      hil run s-slow --duration 600 --live
      hil run x.bench.toml y.bench.toml z.bench.toml --mount mount.toml --arm
    """
    if mount is not None or len(benches) > 1:
        _run_several(benches, link, mount, out, options, arm=arm, dry_run=dry_run, live=live, as_json=json)
    from hil.cli import consent
    from hil.cli.consent import prepare
    from hil.cli.progress import watching
    from hil.cli.show import finish, question, show_identity
    from hil.errors import InputError
    from hil.running.request import request_of

    if live and dry_run:
        raise InputError("--live: without --dry-run, which records nothing to look at; leave one out")
    if link is not None and len(link) > 1:
        raise InputError(f"--link: {len(link)} given for one bench file; give one")
    request = request_of(benches[0], options, link=link[0] if link else None, dry_run=dry_run)
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
        from hil.running.run import run as run_loop

        done = run_loop(request, out, progress=watch)
    if done.folder is not None:
        finish(done.folder, as_json=json)
    show_identity(url, done.identity, declared, done.outcome.get("plugins", ()), as_json=json)
    if not json and declared.loop.clock != "lockstep":
        _show_what_is_held(declared, url)


def _run_several(
    benches: list[str],
    links: list[str] | None,
    mount: Path | None,
    out: Path,
    options: LocalRunOptions,
    *,
    arm: bool,
    dry_run: bool,
    live: bool,
    as_json: bool,
) -> NoReturn:
    from hil.bench.mount import load_mount
    from hil.cli import consent
    from hil.cli.consent import prepare
    from hil.cli.progress import watching
    from hil.cli.show import finish_attitude, question
    from hil.errors import InputError
    from hil.running.several import requests_of, require_together, run_several

    if mount is None:
        raise InputError("--mount: missing; several gyros need the file that says where their sensitive axes point")
    if dry_run:
        raise InputError("--dry-run: of one board; give one bench file")
    requests, declared = requests_of(benches, links, options), load_mount(mount)
    require_together(requests, declared)
    for request in requests:
        question(request.bench)
        if not request.emulated:
            consent.require(request.link, request.bench, given=arm)
        prepare(request.bench)
    with watching("attitude") as watch:
        folder = run_several(requests, declared, out, live=_say_live if live else None, progress=watch)
    finish_attitude(folder, as_json=as_json)


def _say_live(url: str) -> None:
    import sys

    from hil.cli.run_live import show_page

    print(f"live: {url}", file=sys.stderr, flush=True)
    show_page(url)


def _show_what_is_held(bench: "Bench", url: str) -> None:
    """After a dry run: what the run may ask of this machine."""
    from hil.boards.emulation import is_emulated
    from hil.cli.doctor import print_holds
    from hil.cli.progress import watching
    from hil.doctor import link
    from hil.errors import printable
    from hil.running.rehearsal import measured

    if is_emulated(url):
        with watching("measure late answers") as watch:
            found = measured(bench, url, watch, becomes="would be started")
            print(printable(f"machine    {found.words}"))
        return
    _, there = link.examine(url)
    if there is not None:
        print_holds(there["holds"])
