"""What a term does over an interval beside its integral, by SciPy where the force has a kink or a step."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import expm

from estimator.missing_force.library import Extent, library
from estimator.missing_force.linear import Linear
from estimator.missing_force.points import Points, points_of
from estimator.missing_force.readings import Readings

SAMPLES, STEP = 60, 0.3


def course(drive: np.ndarray | None = None) -> Points:
    """One axis without damping on q = cos t, a drive (n,) held over each interval."""
    t = np.arange(SAMPLES) * STEP
    motion = np.stack([np.cos(t), -np.sin(t)], axis=1)
    held = np.zeros(SAMPLES) if drive is None else drive
    linear = Linear(
        sense=motion[:, :1], drive=held[:, None, None], step=STEP, noise=np.array([1e-3]),
        constants={"kxx": 1.0, "drive_gain_x": 1.0}, offset=np.zeros(1), rate=np.zeros(SAMPLES),
    )  # fmt: skip
    return points_of(linear, motion, np.zeros((SAMPLES, 1)), None, Readings(lost=(np.zeros((0, 2)),)))


@pytest.mark.parametrize("width", [0.003, 0.02, 0.2])
def test_friction_is_what_it_does_though_the_velocity_runs_through_its_width_within_an_interval(width: float) -> None:
    points = course()
    (term, *_) = (one for one in library(1, Extent(1.0, 1.0, 1.0)) if one.form == "tanh(v/v0)")
    pushed, _ = points.evaluated(term.at(width))
    worst = 0.0
    for k in range(1, SAMPLES):
        begin, end = (k - 1) * STEP, k * STEP
        turn = [np.pi * round(end / np.pi)] if begin < np.pi * round(end / np.pi) < end else None

        def impulse(at: float, end: float = end) -> float:
            return float(np.cos(end - at) * np.tanh(-np.sin(at) / width))

        worst = max(worst, abs(pushed[k, 1, 0] - quad(impulse, begin, end, points=turn, limit=200)[0]))
    assert worst < 0.02 * STEP


@pytest.mark.slow
def test_a_drive_that_changes_no_faster_ramps_and_stays() -> None:
    """1 is asked for at once; with 2 per unit of time it is there after half of one."""
    drive = np.where(np.arange(SAMPLES) < 10, 0.0, 1.0)
    extent = Extent(1.0, 1.0, 1.0, steepest=1.0)
    (term, *_) = (one for one in library(1, extent) if one.form == "u slewed at S, less u")
    points = course(drive)
    pushed, _ = points.evaluated(term.at(2.0))
    state = np.zeros(2)
    for k in range(1, SAMPLES):
        state = expm(np.array([[0.0, 1.0], [-1.0, 0.0]]) * STEP) @ state + pushed[k, :, 0]
    begin, end = 9 * STEP, (SAMPLES - 1) * STEP

    def lost(at: float) -> float:
        return max(1.0 - 2.0 * (at - begin), 0.0)

    position = -quad(lambda at: np.sin(end - at) * lost(at), begin, begin + 0.5)[0]
    velocity = -quad(lambda at: np.cos(end - at) * lost(at), begin, begin + 0.5)[0]
    assert state == pytest.approx([position, velocity], rel=0.01, abs=1e-4)
