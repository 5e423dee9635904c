"""The first line of the page: what came of the run, in one sentence and a few numbers."""

import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from hil.boards.emulation import shown
from hil.errors import InputError
from hil.numbers import count, counted, in_both, percent, quantity, sensed, share, significant
from hil.records.result import Result
from hil.records.runfolder import RunFolder

if TYPE_CHECKING:
    from hil.records.diagnosis import Diagnosis


_WORDS = {"lacks": "lacks something"}


class Headline(NamedTuple):
    """`tone` is a CSS class: good, slow (this machine's trouble only), bad or open."""

    tone: str
    word: str
    sentence: str


def headline(result: Result) -> Headline:
    """The verdict of result.json, or what can be said without one."""
    against = list(result.against)
    if result.verdict in ("failed", "unsafe"):
        tone = "slow" if against == ["machine"] else "bad"
        word, said = result.verdict.capitalize(), _outcomes(result)
        said = said or list(result.reasons) or ["a limit of the bench file was not kept"]
    elif result.verdict == "interrupted" or not result.complete:
        length = f"{counted(result.samples, 'sample')}, {significant(result.seconds)} s"
        end = "" if result.complete else ", and no end marker"
        tone, word, said = "bad", "Interrupted", [*result.reasons, f"the record holds {length}{end}"]
    else:
        tone, word = ("good", "Good") if result.verdict == "good" else ("open", "Recorded")
        said = _findings(result)
    sentence = "; ".join(said)
    return Headline(tone, word, sentence[0].upper() + sentence[1:])


def alarm(result: Result) -> str:
    """What stands above everything else on the page of an unsafe run, else nothing."""
    return result.alarm[:1].upper() + result.alarm[1:] if result.verdict == "unsafe" else ""


def parts(result: Result) -> list[tuple[str, str, str, str, str]]:
    """The verdict's parts, worst first: (tone, name, outcome, reason, next); those nobody could judge are left out."""
    return [
        (
            ("slow" if name == "machine" else "bad")
            if part.against
            else "open"
            if part.outcome == "unknown"
            else "good",
            name,
            part.outcome,
            part.beside_outcome,
            part.next or "",
        )
        for name, part in result.parts.items()
        if part.outcome != "unknown" or part.reason
    ]


def next_step(result: Result) -> str | None:
    """The command that comes next, but for the one that opens this page."""
    return None if result.next is None or result.next.startswith("xdg-open ") else result.next


def key_figures(result: Result, earlier: Result | None = None) -> list[tuple[str, str, str]]:
    """Headline numbers: (what, number, remark); of a run after a trace with those of the run before it."""

    def before(value: float | None, unit: str) -> str:
        return "" if value is None else f"; before: {sensed(value, unit)}"

    first = Result(run="", seconds=0.0, samples=0, complete=True) if earlier is None else earlier
    entries: list[tuple[str, str, str]] = []
    if result.angle is not None and result.angle_expanded_rad is not None:
        remark = f"± {quantity(result.angle_expanded_rad, 'rad', 2)} (k = 2), since scoring starts"
        entries.append(("Angle", in_both(result.angle.rad, "rad"), remark))
    if result.angle_error_rms_rad is not None:
        remark = "rms" + before(first.angle_error_rms_rad, "rad")
        entries.append(("Angle error", in_both(result.angle_error_rms_rad, "rad"), remark))
    if result.rate_error_rms_rad_s is not None:
        remark = "rms" + before(first.rate_error_rms_rad_s, "rad/s")
        entries.append(("Rate error", in_both(result.rate_error_rms_rad_s, "rad/s"), remark))
    score = result.score
    if score is not None and score.angle_per_rotation is not None:
        remark = f"1 is perfect; over {significant(score.turns)} rotations"
        entries.append(("Angle per rotation", f"{score.angle_per_rotation:.6f}", remark))
    if result.innovation_rms is not None:
        ratio = result.residual_ratio
        remark = "rms" if ratio is None else f"rms, {significant(ratio)} × the noise floor"
        remark += before(first.innovation_rms, result.sense_unit)
        entries.append(("Innovation", sensed(result.innovation_rms, result.sense_unit), remark))
    entries.append(_samples(result))
    if result.turnaround_us is not None:
        remark = f"p50; p99.9 {significant(result.turnaround_us.p999)} µs"
        entries.append(("Turnaround", f"{significant(result.turnaround_us.p50)} µs", remark))
    return entries


def _findings(result: Result) -> list[str]:
    found: list[str] = []
    if result.angle_error_rms_rad is not None:
        turned = "" if result.score is None else f" over {significant(result.score.turns)} rotations"
        found.append(f"angle within {quantity(result.angle_error_rms_rad, 'rad')} rms{turned}")
    if (ratio := result.residual_ratio) is not None:
        found.append(f"innovation at {significant(ratio)} × the noise floor")
    lost = "nothing lost" if not result.lost else f"{counted(result.lost, 'sample')} lost"
    found.append(f"{counted(result.samples, 'sample')}, {lost}")
    if result.answers is not None and result.answers.missed:
        found.append(f"{share(result.answers.missed, result.answers.ticks)} without an answer in time")
    return found


def _outcomes(result: Result) -> list[str]:
    """Every part with what it came to, those against the run first."""
    judged = [(name, part) for name, part in result.parts.items() if part.outcome != "unknown"]
    return [
        ", ".join(f"{name} {_WORDS.get(part.outcome, part.outcome)}" for name, part in judged if part.against is wanted)
        for wanted in (True, False)
        if any(part.against is wanted for _, part in judged)
    ]


def _samples(result: Result) -> tuple[str, str, str]:
    answers = result.answers
    if answers is None:
        return "Samples", count(result.samples), f"{count(result.lost)} lost"
    first, *rest = answers.parts
    others = [f"{count(answers.parts[name])} {name}" for name in rest if answers.parts[name]]
    remark = f"of {counted(answers.ticks, 'sample')}" + ("; " + ", ".join(others) if others else "")
    number = percent(answers.in_time / answers.ticks, 2 if others else 0)
    return first.capitalize(), number, remark


_STAMP = "%Y%m%d-%H%M%S"
_LENGTH = len("20250314-092653")


def facts(result: Result, bench: Mapping[str, Any]) -> Iterator[str]:
    """Those that are known, in words; the date is that in the name of the run."""
    if (when := date_of(result.run)) is not None:
        yield when
    device = bench.get("device")
    name = device.get("name") if isinstance(device, Mapping) else None
    named = [word for word in (name or (result.sensor and result.sensor.device), result.serial_number) if word]
    if named:
        yield f"board {' '.join(named)}"
    if result.link is not None:
        yield shown(result.link)
    yield "a replay" if result.clock is None and result.sensor is None else result.clock or "its own clock"
    yield f"{significant(result.seconds, 4)} s"
    if (made_by := result.versions.get("gyrohil")) is not None:
        yield f"gyrohil {made_by}"


def facts_of_trace(folder: Path, diagnosis: "Diagnosis", length: str) -> Iterator[str]:
    """The same of a trace in `folder`: its own date, the bench file's device, the link and the length of its record,
    the version that traced it; the link where the record is a run that lies beside it.
    """
    if (when := date_of(folder.name)) is not None:
        yield when
    yield f"bench {diagnosis.bench}"
    with suppress(InputError):  # a run of which nothing can be told is no reason for a trace to have no page
        run = RunFolder(folder.parent / diagnosis.record).result
        if run is not None and run.link is not None:
            yield shown(run.link)
    yield length
    yield f"gyrohil {version('gyrohil')}"


def date_of(name: str) -> str | None:
    """The date in the name of a folder, as made by this bench; None where there is none.

    >>> date_of("20250314-092653-s-slow")
    '14 March 2025, 09:26'
    """
    with suppress(ValueError):
        when = time.strptime(name[:_LENGTH], _STAMP)
        return f"{when.tm_mday} {_MONTHS[when.tm_mon - 1]} {when.tm_year}, {when.tm_hour:02}:{when.tm_min:02}"
    return None


_MONTHS = (
    "January", "February", "March", "April", "May", "June", "July", "August", "September", "October", "November",
    "December",
)  # fmt: skip
