"""``hil sweep``: many runs on emulated boards, over keys of scenario and bench."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn, Unpack

import typer

from hil.cli.options import RUNS, Json, with_options
from hil.sweeping.options import LocalSweepOptions

if TYPE_CHECKING:
    from hil.library.campaign import Sweep
    from hil.progress import Progress, Watcher
    from hil.sweeping.plan import Plan
    from hil.sweeping.request import CampaignRequest

CampaignArgument = Annotated[
    str, typer.Argument(metavar="CAMPAIGN", help="Campaign file, or the name of an example (s-slow-noise).")
]
DryRun = Annotated[bool, typer.Option("--dry-run", help="List what would be run; make nothing.")]
Only = Annotated[
    int | None, typer.Option("--only", min=0, metavar="RUN", help="Make this one run again, as a run folder.")
]
_LISTED = 20
_SAY_EVERY_S = 30.0


@with_options(LocalSweepOptions)
def sweep(
    campaign: CampaignArgument,
    dry_run: DryRun = False,
    only: Only = None,
    json: Json = False,
    **options: Unpack[LocalSweepOptions],
) -> None:
    """Run a campaign: one row of figures for each run.

    Each run is an emulated board and the host in lockstep, scored with the board's truth. The campaign file says what
    differs from run to run (docs/reference/campaigns.md). The rows are Parquet files in OUT/results. After Ctrl-C or
    a kill, the same command continues and makes no run twice. OUT/report.html shows what the error depends on, and
    the worst runs. Exit code 1: some runs ended early; with --baseline: a figure got worse beyond its interval, or
    fewer runs reach their end; 3: a fault of the program ended one.

    Examples:

    \b
      hil sweep s-slow-noise --dry-run
      hil sweep s-slow-noise
      hil sweep s-slow-noise --only 7
      hil sweep my.campaign.toml --workers 2 --out runs/mine
      hil sweep my.campaign.toml --scheduler tcp://head:8786
      hil sweep my.campaign.toml --baseline main/results --junit gate.xml
    """
    from hil.sweeping.request import request_of

    request = request_of(campaign, options)
    if dry_run:
        _list(request.plan, request.folder, as_json=json)
    elif only is not None:
        _again(request.plan, request.folder, only, as_json=json)
    else:
        _carry_out(request, as_json=json)


def _list(plan: "Plan", folder: Path, *, as_json: bool) -> None:
    from hil.cli.show import print_json
    from hil.errors import printable
    from hil.sweeping.columns import shown

    if as_json:
        runs = [
            {"run": one.run, "point": one.point, "repeat": one.repeat, "seed": one.seed}
            | {name: shown(value) for name, value in one.values.items()}
            for one in plan.runs()
        ]
        print_json({"campaign": plan.campaign.name, "folder": str(folder), "runs": runs})
        return
    print(printable(f"{plan.campaign.name}: {len(plan)} runs of {plan.samples} samples, into {folder}"))
    for number in range(min(len(plan), _LISTED)):
        one = plan.run(number)
        values = ", ".join(f"{name} {_short(value)}" for name, value in one.values.items())
        print(printable(f"  run {one.run}  point {one.point}  seed {one.seed}  {values}".rstrip()))
    if len(plan) > _LISTED:
        print(f"  … and {len(plan) - _LISTED} more; --json lists all")


def _short(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _carry_out(request: "CampaignRequest", *, as_json: bool) -> NoReturn:
    from hil.cli.progress import watching
    from hil.library.campaign import carried_out
    from hil.sweeping.sweep import Stopped

    plan, folder = request.plan, request.folder
    again = f"hil sweep {plan.called}" + (f" --out {folder}" if folder != RUNS / plan.campaign.name else "")
    with watching(plan.campaign.name, whole=True) as watch:
        try:
            found = carried_out(request, _told(watch))
        except Stopped as stopped:
            raise KeyboardInterrupt(f"{stopped}; `{again}` goes on") from None
    _finish(plan, found, as_json=as_json)


def _told(watch: "Watcher") -> "Watcher":
    """On a terminal the bar says it; into a pipe a line now and then: how far it is, and how long it still takes."""
    import sys

    from hil.cli.show import say
    from hil.tracing.time_left import in_words

    said = time.monotonic()
    note = ""

    def told(progress: "Progress") -> None:
        nonlocal said, note
        watch(progress)
        if sys.stderr.isatty():
            return
        if progress.note and progress.note != note:
            note = progress.note
            say(note)
        if time.monotonic() - said > _SAY_EVERY_S or progress.done == progress.total:
            said = time.monotonic()
            left = None if progress.done == progress.total else progress.left_s
            say(f"{progress.done} of {progress.total} runs{'' if left is None else f', {in_words(left)}'}")

    return told


def _finish(plan: "Plan", found: "Sweep", *, as_json: bool) -> NoReturn:
    from hil.cli.show import print_json
    from hil.errors.ending import ExitCode, is_fault

    made = {"made": found.made, "seconds": round(found.seconds, 1), "report": str(found.report())}
    told = summary(plan, found) | made
    if as_json:
        print_json(told)
    else:
        _print(told, [one.line for one in found.worse])
    if any(map(is_fault, found.table["reason"].to_pylist())):
        raise typer.Exit(ExitCode.FAULT)
    whole = told["outcomes"].get("ran", 0) == told["runs"] or told["baseline"] is not None
    raise typer.Exit(ExitCode.GOOD if whole and not found.worse else ExitCode.AGAINST)


def summary(plan: "Plan", found: "Sweep") -> dict[str, Any]:
    """What `--json` says of a campaign."""
    from collections import Counter

    from hil.sweeping.ensemble import knows, over_bound

    table, dependence = found.table, found.dependence
    honesty = knows(table) if plan.campaign.each.drawn_initial else None
    return {
        "campaign": plan.campaign.name,
        "folder": str(found.path),
        "runs": len(table),
        "outcomes": dict(Counter(table["outcome"].to_pylist())),
        "figure": plan.campaign.report.figure,
        "dependence": None
        if dependence is None
        else {
            "explained": dependence.explained,
            "predicted": dependence.predicted,
            "between_seeds": dependence.between_seeds,
            "keys": [{"keys": one.keys, "share": one.share, "ci95": one.interval} for one in dependence.keys],
            "pairs": [{"keys": one.keys, "share": one.share, "ci95": one.interval} for one in dependence.pairs],
        },
        "over_bound": [
            {"error": one.what, "ratio": one.ratio, "ci95": one.interval, "runs": one.runs} for one in over_bound(table)
        ],
        "nees": None
        if honesty is None
        else {"mean": honesty.nees, "band": honesty.nees_band, "runs": honesty.runs, "held": honesty.held},
        "baseline": [one._asdict() for one in found.changes] or None,
        "uncompared": found.uncompared,
        "worst": [
            {"run": one.run, "outcome": one.outcome, "value": one.value, "command": one.command} for one in found.worst
        ],
    }


def _print(told: dict[str, Any], lines: list[str]) -> None:
    from hil.errors import printable
    from hil.numbers import percent

    outcomes = ", ".join(f"{number} {outcome}" for outcome, number in told["outcomes"].items())
    print(printable(f"{told['campaign']}: {told['runs']} runs ({outcomes}), {told['made']} of them made now"))
    if (found := told["dependence"]) is not None:
        share = percent(found["predicted"])
        print(f"\nvariance of {told['figure']}; the fit predicts {share} of that of runs that it was not fitted to")
        for one in [*found["keys"], *(pair for pair in found["pairs"] if pair["ci95"][0] > 0.0)][:12]:
            low, high = one["ci95"]
            named = " × ".join(one["keys"])
            print(printable(f"  {named:<34}{percent(one['share']):>8}  {percent(low)} … {percent(high)}"))
    for one in told["over_bound"]:
        low, high = one["ci95"]
        print(f"\n{one['error']}, over its bound: {one['ratio']:.3f} ({low:.3f} … {high:.3f})", end="")
    if (honesty := told["nees"]) is not None:
        low, high = honesty["band"]
        print(f"\nNEES per entry at the end: {honesty['mean']:.4f}, band {low:.4f} … {high:.4f}", end="")
    if (baseline := told["baseline"]) is not None:
        print(f"\n\nbeside the baseline, {len(baseline)} comparisons", end="")
        for line in lines:
            print(f"\n  worse  {printable(line)}", end="")
        for line in told["uncompared"]:
            print(f"\n  not compared  {printable(line)}", end="")
    print("\n\nworst")
    for one in told["worst"][:5]:
        value = "–" if one["value"] is None else f"{one['value']:.4g}"
        print(printable(f"  run {one['run']:<6} {one['outcome']:<8} {value:<12} {one['command']}"))
    print()
    print(printable(f"results  {told['folder']}/results"))
    print(printable(f"report   {told['report']}"))


def _again(plan: "Plan", folder: Path, number: int, *, as_json: bool) -> NoReturn:
    from hil.cli.progress import watching
    from hil.cli.show import finish, say
    from hil.sweeping.again import make_again

    with watching(f"{plan.campaign.name} {number}") as watch:
        made = make_again(plan, number, RUNS, folder, progress=watch)
    say(made.told)
    finish(made.folder, as_json=as_json)
