"""The first line of the page: what came of the run, in one sentence and a few numbers."""

import math
from typing import NamedTuple

from hil.records.result import Result
from hil.report.numbers import count, quantity, relative, share, significant


class Headline(NamedTuple):
    """`tone` is a CSS class: good, bad or open."""

    tone: str
    word: str
    sentence: str


def headline(result: Result) -> Headline:
    """The verdict of result.json, or what can be said without one."""
    if result.verdict == "unsafe":
        tone, word, parts = "bad", "Unsafe", list(result.reasons)
    elif result.verdict == "failed":
        tone, word, parts = "bad", "Failed", list(result.reasons) or ["a limit of the bench file was not kept"]
    elif result.verdict == "interrupted" or not result.complete:
        length = f"{count(result.samples)} samples, {significant(result.seconds)} s"
        end = "" if result.complete else ", and no end marker"
        tone, word, parts = "bad", "Interrupted", [*result.reasons, f"the record holds {length}{end}"]
    else:
        tone, word = ("good", "Good") if result.verdict == "good" else ("open", "Recorded")
        parts = _findings(result)
    sentence = "; ".join(parts)
    return Headline(tone, word, sentence[0].upper() + sentence[1:])


def key_figures(result: Result) -> list[tuple[str, str, str]]:
    """Headline numbers: (what, number, remark)."""
    entries: list[tuple[str, str, str]] = []
    if result.angle_error_rms_rad is not None:
        remark = f"rms, {quantity(result.angle_error_rms_rad, 'rad')}"
        entries.append(("Angle error", quantity(math.degrees(result.angle_error_rms_rad), "deg"), remark))
    if result.rate_error_rms_rad_s is not None:
        remark = f"rms, {quantity(result.rate_error_rms_rad_s, 'rad/s')}"
        entries.append(("Rate error", quantity(math.degrees(result.rate_error_rms_rad_s), "deg/s"), remark))
    score = result.score
    if score is not None and score.angle_per_rotation is not None:
        remark = f"from 1, over {significant(score.turns)} turns"
        entries.append(("Angle per rotation", relative(score.angle_per_rotation - 1), remark))
    if result.innovation_rms is not None:
        floor = result.noise_floor
        remark = "rms" if not floor else f"rms, {significant(result.innovation_rms / floor)} × the noise floor"
        entries.append(("Innovation", quantity(result.innovation_rms, "V"), remark))
    entries.append(
        (
            "Samples",
            count(result.samples),
            f"{count(result.lost)} lost, {share(result.late, result.samples)} late",
        )
    )
    if result.turnaround_us is not None:
        remark = f"p50; p99.9 {significant(result.turnaround_us.p999)} µs"
        entries.append(("Turnaround", f"{significant(result.turnaround_us.p50)} µs", remark))
    return entries


def _findings(result: Result) -> list[str]:
    found: list[str] = []
    if result.angle_error_rms_rad is not None:
        turned = "" if result.score is None else f" over {significant(result.score.turns)} turns"
        found.append(f"angle within {quantity(math.degrees(result.angle_error_rms_rad), 'deg')} rms{turned}")
    if result.innovation_rms is not None and result.noise_floor:
        found.append(f"innovation at {significant(result.innovation_rms / result.noise_floor)} × the noise floor")
    lost = "nothing lost" if not result.lost else f"{count(result.lost)} samples lost"
    found.append(f"{count(result.samples)} samples, {lost}")
    if result.late:
        found.append(f"{share(result.late, result.samples)} late")
    return found
