"""What a trace came to, on standard output: one JSON object, or words and tables to read at a glance."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import typer

from hil.errors import printable, printable_json
from hil.errors.ending import ExitCode

if TYPE_CHECKING:
    from hil.records.diagnosis import Diagnosis, Finding, Separation

_STYLE = {"adequate": "green", "explained": "green", "partly explained": "yellow", "unexplained": "red"}
_COMPLETE = ("adequate", "explained")
_FINDINGS = 6
_REJECTED = 5


def finish(
    folder: Path, diagnosis: "Diagnosis", *, as_json: bool, added: Path | None = None, record: Path | None = None
) -> NoReturn:
    """Print the diagnosis and leave: exit code 0, or 1 when something is left that nothing accounts for.

    added: bench file that declares what was found, where one was written.  record: the capture that was traced, where
    that is known.
    """
    if as_json:
        print(printable_json((folder / "diagnosis.json").read_text(encoding="utf-8")), end="")
    else:
        from hil.verdict.next_step import after_trace

        print_diagnosis(diagnosis)
        print()
        print(printable(f"diagnosis  {folder / 'diagnosis.json'}"))
        if (folder / "force.arrow").exists():
            print(printable(f"force      {folder / 'force.arrow'}"))
        page = folder / "report.html"
        if page.exists():
            print(printable(f"report     {page}"))
        if (command := after_trace(folder, diagnosis, added, record=record)) is not None:
            print(printable(f"next       {command}"))
    raise typer.Exit(ExitCode.GOOD if diagnosis.verdict in _COMPLETE else ExitCode.AGAINST)


def print_diagnosis(diagnosis: "Diagnosis") -> None:
    """Verdict, how probable, residual, effects, before and after, what cannot be told apart, what was ruled out."""
    from hil.cli.output import Output
    from hil.numbers import quantity
    from hil.report.diagnosis.equations import plain
    from hil.report.diagnosis.tables import dependence, estimate, fit_rows, floor_from, force_terms, left_with, probable

    output, style = Output(), _STYLE[diagnosis.verdict]
    say = output.say
    say(diagnosis.record, style="bold", end="  ")
    say(diagnosis.verdict, style=style)
    for reason in (*diagnosis.prepared, *diagnosis.reasons, *diagnosis.undetermined):
        say(f"  {reason}")
    for shares in diagnosis.probabilities:
        say(f"  {probable(shares)}")
    for effect in diagnosis.effects:
        say()
        acts = "acts like: " if diagnosis.verdict == "partly explained" else ""
        say(f"{acts}{effect.title}", style="bold", end="  ")
        say(f"[effects.{effect.name}]")
        for equation in effect.equations:
            say(f"  {plain(equation)}")
        for symbol, found in effect.coefficients.items():
            say(f"  {symbol} = {estimate(found)}, 95 %")
        left = effect.angle_bound_rad
        rest = "" if left is None else f"; the angle stays uncertain by {quantity(left, 'rad')} (95 %)"
        say(f"  {effect.compensation}{rest}")
    if (best := diagnosis.unconfirmed) is not None:
        say()
        say(f"not confirmed: {', '.join(effect.name for effect in best.effects)}", style="bold", end="  ")
        say(left_with(best))
        for failed in best.failed:
            say(f"  failed: {failed}")
        for effect in best.effects:
            for symbol, found in effect.coefficients.items():
                say(f"  {symbol} = {estimate(found)}, 95 %")
    if diagnosis.base:
        say()
        say("straight line V0 + S Ω, as fitted", style="bold")
        for symbol, found in diagnosis.base.items():
            say(f"  {symbol} = {estimate(found)}, 95 %")
    for goes in diagnosis.dependences:
        say()
        say(f"{goes.name} depends on {goes.covariate}", style="bold")
        say(f"  {dependence(goes)}")
    say()
    head, fits = fit_rows(diagnosis)
    output.table(head, fits, right=range(1, len(head)))
    if floor := floor_from(diagnosis).strip():
        say(floor)
    if diagnosis.angle_moved_rad is not None:
        whose = "it" if len(diagnosis.effects) == 1 else "what brings the residual down"
        moved = quantity(diagnosis.angle_moved_rad, "rad")
        say()
        say(f"including {whose} in the model moves the reported angle by up to {moved} over the scored window")
    if diagnosis.share is not None and diagnosis.verdict == "partly explained":
        say()
        say(f"accounts for {diagnosis.share:.1%} of the power above the noise floor on the part held out")
    if diagnosis.missing_force is not None:
        say()
        say(diagnosis.missing_force.text)
        for line in force_terms(diagnosis.missing_force):
            say(f"  {line}")
    _say_findings(say, "the residual that is left", diagnosis.left, diagnosis.sense_unit)
    heading = "the residual without it" if diagnosis.effects else "the residual"
    _say_findings(say, heading, diagnosis.findings, diagnosis.sense_unit)
    for group in diagnosis.ambiguity_groups:
        say()
        say(f"ambiguity group of this record: {', '.join(group)}")
    for pair in diagnosis.separations:
        alike = "" if pair.correlation is None else f" (correlation of their signatures {pair.correlation:.5f})"
        told = told_apart(pair)
        apart = pair.angle_apart_rad
        hangs = "" if apart is None else f"; the angle moves by up to {quantity(apart, 'rad')} if it is that"
        say(f"  {pair.effect} from {pair.with_}{alike}{hangs}; {told}")
    if diagnosis.rejected:
        say()
        say("ruled out")
        for one in diagnosis.rejected[:_REJECTED]:
            say(f"  {one.name}: {one.reason}")
        if len(diagnosis.rejected) > _REJECTED:
            say(f"  … and {len(diagnosis.rejected) - _REJECTED} more, in the report")


def told_apart(pair: "Separation") -> str:
    """What tells two effects apart, in words."""
    if pair.separate_by is None:
        return "no experiment separates them"
    lasting = "" if pair.takes_s is None else f", for {pair.takes_s:.2g} s at least"
    return f"to separate them: {pair.separate_by}{lasting}"


def _say_findings(say: Callable[[str], None], heading: str, findings: "tuple[Finding, ...]", unit: str) -> None:
    from hil.numbers import sensed

    if findings:
        say("")
        say(heading)
    for finding in findings[:_FINDINGS]:
        size = "" if finding.size_V is None else f"{sensed(finding.size_V, unit):>9}  "
        say(f"  {size}{finding.text}")
