"""What a run came to, on standard output: one JSON object, or a table to read at a glance."""

import json
import math
import sys
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import typer

from hil.cli.output import Output
from hil.errors import printable, printable_json
from hil.errors.ending import ExitCode, is_fault

if TYPE_CHECKING:
    from hil.bench import Bench
    from hil.demo import Circle, Single
    from hil.records.result import Result

_VERDICT_STYLE = {"good": "green", "failed": "red", "interrupted": "yellow", "unsafe": "bold white on red"}
_OUTCOME_STYLE = {"good": "green", "complete": "green", "unknown": "dim", "unsafe": "bold white on red"}  # else red
_REMARKS = 8  # that are shown; a machine that is far too busy has hundreds
_IN_TIME = "answered in time"
_MACHINE_STYLE = "yellow"  # of a run whose only trouble is this machine's


def say(sentence: str) -> None:
    """A remark to the user, on standard error."""
    print(printable(sentence), file=sys.stderr, flush=True)


def print_json(figures: Mapping[str, Any]) -> None:
    """One JSON object on standard output."""
    print(printable_json(json.dumps(figures, indent=2, ensure_ascii=False, allow_nan=False)))


def finish(folder: Path, *, as_json: bool, good: bool | None = None, told: Sequence[str] = ()) -> NoReturn:
    """Print the figures of the run in ``folder`` and leave: exit code 0 unless the verdict is against it, or with
    ``good`` by what that says.  told: remarks that were printed before."""
    from hil.records.result import load_result
    from hil.records.runfolder import RunFolder

    run = RunFolder(folder)
    result = load_result(run.result_path)
    _ = run.bench_text  # figures of a run whose bench file was changed since are not shown as its own
    if as_json:
        if result.verdict == "unsafe":
            say(f"UNSAFE: {result.alarm}")
        print(printable_json(run.result_path.read_text(encoding="utf-8")), end="")
    else:
        result = result.model_copy(update={"remarks": tuple(one for one in result.remarks if one not in told)})
        _print_tables(result, run.report_path)
    if any(map(is_fault, result.reasons)):
        raise typer.Exit(ExitCode.FAULT)
    is_good = result.verdict in (None, "good") if good is None else good
    raise typer.Exit(ExitCode.GOOD if is_good else ExitCode.AGAINST)


def finish_attitude(folder: Path, *, as_json: bool) -> NoReturn:
    """Print what several gyros came to and leave: exit code 0 where all is good."""
    from hil.numbers import in_both, quantity, significant
    from hil.records.attitude import load_attitude_result

    result = load_attitude_result(folder)
    if as_json:
        print(printable_json((folder / "attitude.json").read_text(encoding="utf-8")), end="")
    else:
        print(printable(folder.name))
        for one in result.axes:
            angle = "" if one.angle_rad is None else in_both(one.angle_rad, "rad")
            print(printable(f"  {one.name}  {one.verdict or 'no verdict':<12} {angle:<28} {one.run}"))
        if result.quaternion is not None and result.u_rad is not None and result.coning_rad is not None:
            print(f"quaternion  {', '.join(significant(part, 6) for part in result.quaternion)}")
            print(f"            ± {in_both(2.0 * result.u_rad, 'rad')} (k = 2)")
            print(f"coning      {quantity(result.coning_rad, 'rad')}")
        elif result.without:
            print(printable(f"no attitude: {result.without}"))
        if (stop := result.stop) is not None:
            safe = ", ".join(
                f"{name} after {quantity(after, 's')}" for name, after in sorted(stop.safe_after_s.items())
            )
            print(printable(f"stopped by {stop.by}; SAFE: {safe}"))
        print(f"verdict     {result.verdict}")
        print(printable(f"report      {folder / 'report.html'}"))
    raise typer.Exit(ExitCode.GOOD if result.verdict == "good" else ExitCode.AGAINST)


def print_under_test(shown: "Circle | Single") -> None:
    """What an emulated board was started with and why, and what the demonstration was to show."""
    output = Output()
    for words in shown.told:
        output.say(f"machine    {words}")
    for one in shown.under_test:
        style, word = ("green", "shown") if one.held else ("red", "not shown")
        output.say(f"{word:<11}", style=style, end="")
        output.say(one.words)
    output.say()


def print_before_and_after(circle: "Circle") -> None:
    """What the trace of the first run found, and the figures of both runs beside each other."""
    from hil.cli.show_diagnosis import print_diagnosis
    from hil.records.diagnosis import load_diagnosis
    from hil.records.result import TOO_SLOW, load_result
    from hil.records.runfolder import RunFolder

    if circle.trace is None:
        print(printable(f"no trace of the first run: {circle.untraced}") + "\n")
        return
    print_diagnosis(load_diagnosis(circle.trace / "diagnosis.json"))
    if circle.after is None:
        print("\nnothing to add to the model: no second run\n")
        return
    results = [load_result(RunFolder(run).result_path) for run in (circle.before, circle.after)]
    before, after = (dict(_figures(result)) for result in results)
    print("\nthe loop without it and with it", flush=True)
    labels = ("angle error, rms", "angle per rotation", "rate error, rms", "innovation, rms", _IN_TIME)
    rows = [(label, before.get(label, ""), after.get(label, "")) for label in labels]
    Output().table(("", "before", "after"), rows)
    if not all(result.kept_up for result in results):
        print(textwrap.fill(f"{TOO_SLOW}; that part is told apart from the model's, below", 80))
    print()


def show_identity(
    link: str, identity: Mapping[str, Any], bench: "Bench", remarks: Sequence[str] = (), *, as_json: bool
) -> None:
    """Who answered at ``link``, after a dry run in which bench file and board agreed, and what the bench comes to; the
    remarks are those on its plug-ins.
    """
    from hil.wire.messages import Capabilities, version_of

    if as_json:
        print_json({"link": link, "identity": identity, **echo_figures(bench, identity), "remarks": list(remarks)})
        return
    print(f"{printable(link)} answers and agrees with the bench file; not armed")
    written: dict[str, Callable[[int], str]] = {
        "spec_hash": "{:#010x}".format,
        "firmware": version_of,
        "capabilities": lambda bits: ", ".join(one.name or str(one.value) for one in Capabilities(bits)),
    }
    for name, value in identity.items():
        print(printable(f"  {name:<18}{written.get(name, str)(value)}"))
    print("from the bench file")
    print_echo(bench, identity)
    for remark in remarks:
        print(printable(f"remark: {remark}"))


def print_echo(bench: "Bench", identity: Mapping[str, Any] | None = None) -> None:
    """What a bench file comes to, a line each, and a question for each number that is improbable."""
    from hil.bench.derived import derived
    from hil.bench.improbable import questions

    for line in derived(bench, identity):
        print(printable(f"  {line.name:<18}{line.text}"))
    for question in questions(bench, identity):
        print(printable(f"question: {question}"))


def question(bench: "Bench") -> None:
    """Ask about each improbable number on standard error, before a board is armed."""
    from hil.bench.improbable import questions

    for one in questions(bench):
        say(f"question: {one}")


def echo_figures(bench: "Bench", identity: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """The same for `--json`: numbers with the unit in their name, and the questions."""
    from hil.bench.derived import derived, figures_of
    from hil.bench.improbable import questions

    return {"derived": figures_of(derived(bench, identity)), "questions": questions(bench, identity)}


def _print_tables(result: "Result", report: Path) -> None:
    output = Output()
    if result.verdict == "unsafe":
        output.say(" UNSAFE ", style=_VERDICT_STYLE["unsafe"], end=" ")
        output.say(result.alarm, style="bold red")
        output.say()
    output.say(result.run, style="bold")
    output.say()
    for label, value in _figures(result):
        output.say(f"{label:<34}{value}")
    if result.parameters:
        output.say()
        _print_parameters(output, result)
    output.say()
    if result.verdict is not None:
        _print_verdict(output, result)
    for remark in result.remarks[:_REMARKS]:
        output.say(f"remark   {remark}")
    if (more := len(result.remarks) - _REMARKS) > 0:
        output.say(f"remark   … and {more} more in result.json")
    if report.exists():
        output.say(f"report   {report}")
    if result.next is not None:
        output.say(f"next     {result.next}")


def _print_verdict(output: Output, result: "Result") -> None:
    """The verdict, why the run ended early, and each part: what it came to, why, what to do about it."""
    assert result.verdict is not None
    against = list(result.against)
    named = f": {', '.join(against)}" if result.verdict == "failed" and against else ""
    if result.verdict == "good" and result.angle is not None and result.angle_expanded_rad is None:
        named = "; the angle's uncertainty is unknown"
    output.say("verdict  ", end="")
    output.say(
        f"{result.verdict}{named}", style=_MACHINE_STYLE if against == ["machine"] else _VERDICT_STYLE[result.verdict]
    )
    told = [part.reason for part in result.parts.values()]
    for reason in result.reasons:
        if reason not in told:
            output.say(f"         {reason}")
    for name, part in result.parts.items():
        if part.outcome == "unknown" and not part.reason:
            continue
        colour = _MACHINE_STYLE if name == "machine" and part.against else _OUTCOME_STYLE.get(part.outcome, "red")
        output.say(f"         {name:<9}", end="")
        output.say(f"{part.outcome:<9}", style=colour, end="")
        output.say(part.beside_outcome)
        if part.next is not None and part.next != result.next:
            output.say(f"{'':<27}next: {part.next}")


def _figures(result: "Result") -> Iterator[tuple[str, str]]:
    from hil.boards.emulation import shown
    from hil.numbers import count, counted, in_both, percent, sensed, signed, significant, typeset

    if result.link is not None:
        yield "link, clock", f"{shown(result.link)}, {result.clock}"
    yield "length", f"{significant(result.seconds, 4)} s, {counted(result.samples, 'sample')}"
    if (answers := result.answers) is not None:
        yield (
            _IN_TIME,
            f"{count(answers.in_time)} of {count(answers.ticks)} ({percent(answers.in_time / answers.ticks, 2)})",
        )
        rest = [f"{count(part)} {name}" for name, part in answers.parts.items() if part and name != _IN_TIME]
        if rest:
            yield "the others", ", ".join(rest)
    elif result.sensor is None:
        yield "lost", count(result.lost)
    else:
        yield "lost, damaged", f"{count(result.lost)}, {count(result.counters['crc_errors'])}"
    if result.turnaround_us is not None:
        yield "turnaround p50, p99, p99.9", result.turnaround_us.line
    if result.ledger_us is not None:
        yield "sample to effect p50, p99, p99.9", result.ledger_us.total.line
    if result.holds is not None:
        yield "setting for this machine", result.holds.line
    if result.board_clock is not None:
        yield "board's clock", result.board_clock.line
        if result.board_clock.sample_rate is not None:
            yield "sample rate", result.board_clock.sample_rate.line
    if result.reference is not None:
        yield "beside the reference", result.reference.line
    if result.load is not None:
        yield "host's loop, recorder", f"{percent(result.load.loop, 0)}, {percent(result.load.recorder, 0)} of a core"
    for one in result.algorithm:
        limit = "" if one.limit is None else f", limit {significant(one.limit, 4)} {one.unit}"
        value = "not known" if one.value is None else f"{significant(one.value, 4)} {one.unit}".removesuffix(" 1")
        yield one.name.replace("_", " "), f"{value}{limit}"
    if result.bare_turnaround_us is not None:
        yield "the same of a bare read and write", result.bare_turnaround_us.line
    if (sensor := result.sensor) is not None:
        yield "sensor", f"{sensor.device}, {significant(sensor.sample_rate_Hz, 6)} samples a second by its own clock"
        if sensor.host_rate_Hz is not None:
            apart = 1e6 * (sensor.host_rate_Hz / sensor.sample_rate_Hz - 1.0)
            yield "its clock relative to this machine's", f"{typeset(f'{apart:+.0f}')} ppm"
        for axis, channel in sensor.channels.items():
            noise = (
                ""
                if channel.noise_rad_s is None
                else f", noise {significant(math.degrees(channel.noise_rad_s))} °/s rms"
            )
            yield f"rate {axis}", f"{signed(math.degrees(channel.mean_rad_s), 5)} °/s mean{noise}"
        if sensor.latency_us is not None:
            yield "its latency p50, p99, p99.9", sensor.latency_us.line
    if result.innovation_rms is not None:
        unit, floor = result.sense_unit, result.noise_floor
        told = "" if floor is None else f"; noise floor {sensed(floor, unit)}, predicted"
        yield "innovation, rms", f"{sensed(result.innovation_rms, unit)}{told}"
    yield from _angle(result)
    if result.board is not None:
        yield "board's own less the host's", result.board.line
    if result.angle_error_rms_rad is not None:
        yield "angle error, rms", in_both(result.angle_error_rms_rad, "rad")
    if result.score is not None and result.score.angle_per_rotation is not None:
        yield "angle per rotation", f"{result.score.angle_per_rotation:.6f}"
    if result.rate_error_rms_rad_s is not None:
        yield "rate error, rms", in_both(result.rate_error_rms_rad_s, "rad/s")
    if result.score is not None and (nees := result.score.nees) is not None:
        low, high = nees.band
        yield "NEES per entry", f"{significant(nees.mean)} of {nees.entries} entries; 95 % band {low:.2f} to {high:.2f}"


def _angle(result: "Result") -> Iterator[tuple[str, str]]:
    """The angle at the end of the scored window with its uncertainty, and the source's own beside it."""
    from hil.numbers import in_both, plus_minus, prefix_for, quantity
    from hil.verdict.budget import largest_source

    if (angle := result.angle) is None:
        return
    if (u := result.angle_expanded_rad) is None:
        yield "angle since scoring starts", f"{in_both(angle.rad, 'rad', 5)}, uncertainty not given"
        yield "by", angle.why
        return
    factor, prefix = prefix_for(max(abs(angle.rad), u), 0)
    told = f"{plus_minus(angle.rad * factor, u * factor)} {prefix}rad"
    degrees = plus_minus(math.degrees(angle.rad), math.degrees(u))
    yield "angle since scoring starts", f"{told} ({degrees}°), k = 2"
    if result.uncertainty:
        yield "largest source", largest_source(result.uncertainty[0])
    if angle.why:
        yield "by", angle.why
    if angle.plain_rad is not None and angle.control_imperfection_rms_rad is not None:
        yield "by the patent's formula (11)", in_both(angle.plain_rad, "rad", 5)
        imperfection = quantity(angle.control_imperfection_rms_rad, "rad", 2)
        yield "rotation by drive forces, rms", f"{imperfection} (already subtracted)"


def _print_parameters(output: Output, result: "Result") -> None:
    from hil.numbers import plus_minus, unit_for

    rows = []
    for name, parameter in result.parameters.items():
        half = parameter.half or 0.0
        factor, unit = unit_for(max(abs(parameter.value), 2.0 * half), parameter.unit)
        numbers = (parameter.value, *(parameter.ci95 or ()), parameter.truth)
        value, *ends, truth = (
            "–" if one is None else plus_minus(factor * parameter.value, factor * half, beside=factor * one)
            for one in numbers
        )
        rows.append((name, value, *(ends or ("declared" if parameter.declared else "not given", "")), truth, unit))
    if all(parameter.truth is None for parameter in result.parameters.values()):
        rows = [(*cells, "", unit) for *cells, _, unit in rows]
    output.table(("parameter", "estimate", "95 % interval", "", "truth", ""), rows, right=range(1, 5))
