"""All judgements in figures: runs/undeclared.json, and the page evaluation/results/undeclared.md with its picture."""

import statistics
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

from evaluation.undeclared.calibration import Calibration, calibration
from evaluation.undeclared.judging import Judgement

CONFIDENT = 1.02
"""Innovation over the true noise up to which nothing is left."""


def summarise(judged: Sequence[Judgement]) -> dict[str, Any]:
    """Counts by category, coverage, confusion."""
    of = {category: [j for j in judged if j.category == category] for category in _categories(judged)}
    single, double, calm = of.get("single", []), of.get("double", []), of.get("calm", [])
    outside, clean, never = of.get("outside", []), of.get("clean", []), of.get("never", [])
    return {
        "single": {
            "n": len(single),
            "named_first": sum(j.first_class for j in single),
            "coverage": coverage(single),
            "member_first": sum(j.first_member for j in single),
            "told_apart": sum(j.alone for j in single),
            "member_first_where_told_apart": sum(j.first_member and j.alone for j in single),
            "coefficients": sum(len(j.covered) for j in single),
            "down_to_noise": _down_to_noise(single),
            "adequate": sum(j.verdict == "adequate" for j in single),
            "misnamed": sum(j.misnamed for j in single),
            "surplus": sum(j.surplus > 0 for j in single),
        },
        "clean": {
            "n": len(clean),
            "adequate": sum(j.verdict == "adequate" for j in clean),
            "down_to_noise": _down_to_noise(clean),
        },
        "outside": {
            "n": len(outside),
            "not_misnamed": sum(not j.misnamed for j in outside),
            "not_explained": sum(j.verdict != "explained" for j in outside),
            "unexplained": sum(j.verdict == "unexplained" for j in outside),
            "adequate": sum(j.verdict == "adequate" for j in outside),
        },
        "double": {
            "n": len(double),
            "both_named": sum(j.verdict == "explained" and all(j.right_class) for j in double),
            "coverage": coverage(double),
            "misnamed": sum(j.misnamed for j in double),
        },
        "calm": {
            "n": len(calm),
            "right": sum(j.first_class or (j.verdict == "adequate" and j.bounded) for j in calm),
            "named_first": sum(j.first_class for j in calm),
            "adequate_with_bound": sum(j.verdict == "adequate" and j.bounded for j in calm),
            "adequate": sum(j.verdict == "adequate" for j in calm),
            "experiment_proposed": sum(j.proposes for j in calm),
            "misnamed": sum(j.misnamed for j in calm),
        },
        "never": {"n": len(never), "adequate": sum(j.verdict == "adequate" for j in never)},
        "calibration": stated(judged).written(),
        "calibration_calm": stated(calm).written(),
        "calibration_excited": stated(j for j in judged if j.category != "calm").written(),
        "broken": [j.name for j in judged if j.broken],
        "confusion": confusion(j for j in judged if j.category not in ("double", "calm")),
        "confusion_double": confusion(double),
        "confusion_calm": confusion(calm),
        "records": [_line(j) for j in judged],
    }


def stated(judged: Iterable[Judgement]) -> Calibration:
    """How well the probabilities hold that were stated."""
    return calibration(statement for j in judged for statement in j.statements)


def coverage(judged: Iterable[Judgement]) -> float | None:
    """Share of the 95 % intervals, of effects named exactly, that hold the truth."""
    covered = [one for j in judged for one in j.covered.values()]
    return round(sum(covered) / len(covered), 4) if covered else None


def confusion(judged: Iterable[Judgement]) -> dict[str, dict[str, int]]:
    """By what was hidden, how often what was named first."""
    rows: dict[str, Counter[str]] = {}
    for j in judged:
        rows.setdefault(j.row, Counter())[j.column] += 1
    return {row: dict(sorted(counts.items())) for row, counts in sorted(rows.items())}


def ratios(judged: Iterable[Judgement]) -> dict[str, tuple[float, float, float]]:
    """By what was hidden: smallest, median and largest innovation of the loop's own observer, over the noise."""
    rows: dict[str, list[float]] = {}
    for j in judged:
        if j.innovation_ratio is not None:
            rows.setdefault(j.row, []).append(j.innovation_ratio)
    return {row: (min(r), statistics.median(r), max(r)) for row, r in sorted(rows.items())}


def _down_to_noise(judged: Iterable[Judgement]) -> int:
    return sum(j.after is not None and j.after <= CONFIDENT for j in judged)


def _categories(judged: Iterable[Judgement]) -> list[str]:
    return sorted({j.category for j in judged})


def _line(j: Judgement) -> dict[str, Any]:
    return {
        "name": j.name,
        "verdict": j.verdict,
        "named": list(j.named),
        "first_class": j.first_class,
        "first_member": j.first_member,
        "right_class": list(j.right_class),
        "alone": j.alone,
        "statements": [[round(probability, 6), so] for probability, so in j.statements],
        "covered": dict(j.covered),
        "error_half_widths": {symbol: round(value, 3) for symbol, value in j.error.items()},
        "before": j.before,
        "after": j.after,
        "loop_ratio": j.innovation_ratio,
    }
