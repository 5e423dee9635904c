"""Figures over several records: `benchmarks.comparison.summary`, by hand."""

import math

import pytest

from benchmarks.comparison.summary import pooled, rivalry
from hil.comparing.observers import RATE_IDENTIFIED
from hil.records.methods import MethodRow, Methods


def one(ours: float, raw: float | None, identified: float) -> Methods:
    def row(name: str, kind: str, angle: float | None, **more: float) -> MethodRow:
        return MethodRow.model_validate(
            {"name": name, "kind": kind, "record": "this", "angle_error_rms_rad": angle, **more}
        )

    rows = (
        row("ours", "observer", ours, settled_s=1.0, cost_us=2.0),
        row("raw", "prior art", raw, **({"diverged_s": 3.0} if raw is None else {})),
        row(RATE_IDENTIFIED, "prior art", identified),
    )
    return Methods(record="r", bench="b", seconds=1.0, window_s=(0.0, 1.0), reference="truth", rows=rows)


def test_errors_are_pooled_as_squares() -> None:
    first, *_ = pooled([one(3.0, 1.0, 1.0), one(4.0, 1.0, 1.0)])
    assert first.angle == pytest.approx(math.sqrt(12.5))
    assert first.angles == (3.0, 4.0)
    assert first.settled == (1.0, 1.0)
    assert first.cost_us == 2.0


def test_what_diverged_has_no_end_and_is_counted() -> None:
    raw = pooled([one(1.0, None, 1.0), one(1.0, 2.0, 1.0)])[1]
    assert raw.angle == math.inf
    assert raw.diverged == 1


def test_the_best_rival_with_and_without_the_identified_rate() -> None:
    found = rivalry([one(1.0, 10.0, 0.5), one(1.0, 30.0, 0.5)], "ours")
    name, ratio, low, high = found["best of (a)–(e) as published"]
    assert (name, low, high) == ("raw", 10.0, 30.0)
    assert ratio == pytest.approx(math.sqrt(500.0))
    assert found["best of all"][:2] == (RATE_IDENTIFIED, 0.5)
