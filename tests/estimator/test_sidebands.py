"""Two lines to either side of the vibration (docs/reference/trace.md#what-is-promised), on records of sums of sines."""

import numpy as np
import pytest

from estimator.record import Record
from estimator.trace.sidebands import Sidebands, sidebands, vibration_of

RATE, N, VIBRATION = 4000.0, 8000, 199.83
TURN = 2.0 * np.pi


def record(vibration: float = VIBRATION, *, lost: bool = False) -> Record:
    """An offset, the vibration turning from x to y, a line of a tenth, and noise."""
    t = np.arange(N) / RATE
    moved = np.sin(TURN * vibration * t + 0.4)
    angle = 0.0 if lost else 0.7  # lost, the vibration is in the channel with the gap alone
    sense = np.stack([3.0 + moved * np.cos(angle), moved * np.sin(angle) + 0.1 * np.sin(TURN * 50.0 * t)], axis=1)
    sense += 1e-3 * np.random.default_rng(4).standard_normal((N, 2))
    if lost:
        sense[100:140, 0] = np.nan
    return Record(sense, np.zeros((N, 2, 1)), np.full(N, 1.0 / RATE))


@pytest.mark.parametrize("vibration", [199.83, 200.0, 333.26, 1900.1])
@pytest.mark.parametrize("lost", [True, False])
def test_the_vibration_is_the_strongest_line_between_bins(vibration: float, *, lost: bool) -> None:
    """Bins are 0.5 Hz apart."""
    assert vibration_of(record(vibration, lost=lost)) == pytest.approx(vibration, abs=0.02)


def lines(**hertz: float) -> dict[str, dict[str, float]]:
    return {name.replace("_of_", ":"): {"omega": TURN * value, "lcx": 1.0} for name, value in hertz.items()}


@pytest.mark.parametrize(
    ("at", "found"),
    [
        ({"a": VIBRATION - 12.0, "b": VIBRATION + 12.0}, [("a", "b", 12.0)]),
        ({"b": VIBRATION + 12.0, "a": VIBRATION - 12.0}, [("a", "b", 12.0)]),
        ({"a": VIBRATION - 12.4, "b": VIBRATION + 12.0 + 0.4}, [("a", "b", 12.4)]),
        ({"a": VIBRATION - 12.0, "b": VIBRATION + 12.9}, [("a", "b", 12.45)]),  # as nearly as 2 s tell two apart
        ({"a": VIBRATION - 12.0, "b": VIBRATION + 13.1}, []),
        ({"a": VIBRATION - 12.0, "b": VIBRATION - 12.5}, []),
        ({"a": VIBRATION + 0.1, "b": VIBRATION + 0.2}, []),  # both above
        ({"a": VIBRATION - 12.0, "b": VIBRATION + 12.0, "c": 50.0}, [("a", "b", 12.0)]),
        ({"a": VIBRATION - 12.0}, []),
    ],
)
def test_a_pair_about_the_vibration_is_found(at: dict[str, float], found: list[tuple[str, str, float]]) -> None:
    given = sidebands(record(), lines(**at), at)
    assert [(one.below, one.above) for one in given] == [(below, above) for below, above, _ in found]
    assert [one.distance for one in given] == pytest.approx([distance for *_, distance in found])


def test_only_lines_that_are_named_count() -> None:
    effects = lines(a=VIBRATION - 12.0, b=VIBRATION + 12.0) | {"drag": {"dqx": 1.0}}
    assert sidebands(record(), effects, ["a", "drag"]) == ()
    (pair,) = sidebands(record(), effects, ["a", "b", "drag"])
    assert pair == Sidebands("a", "b", pytest.approx(12.0))
