"""A free run over gaps whose drive nobody knows: constants as without them, nothing made of what acted in a gap."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from estimator.gaps import Gaps
from estimator.observer import Observer
from estimator.record import Record
from estimator.simulation import simulate
from evaluation.measured.free_stretches import FreeRuns
from evaluation.measured.refinement import Refined, refine
from tests.estimator.driven_axis import DEVICE, DRIVE, RATE, SETTINGS, state_of

N = len(DRIVE)
TRUE = {"phi_x": 0.004, "kxx": 1.92e5, "dxx": 41.0, "drive_gain_x": 1.0}
HOLES = ((120, 140), (300, 303))
OBSERVER = Observer(DEVICE, SETTINGS)


def holed() -> Record:
    """The model's own record, its drive in the gaps told wrong."""
    sense = np.array(simulate(OBSERVER, state_of(OBSERVER, **TRUE, x=0.03, vx=5.0), DRIVE).sensed)
    sense += DEVICE.noise[0] * np.random.default_rng(5).standard_normal(sense.shape)
    told = DRIVE.copy()
    for begin, end in HOLES:
        sense[begin:end], told[begin:end] = np.nan, 0.0
    spread = np.full((len(HOLES), 2, 2), np.inf)
    gaps = Gaps(np.array([end - 1 for _, end in HOLES]), spread)
    return Record(sense, told[:, :, None], np.full(N, 1 / RATE), gaps=gaps)


def refined(record: Record, stretches: tuple[slice, ...]) -> Refined:
    free = [name for name in OBSERVER.estimated if name != "drive_gain_x"]
    return refine(OBSERVER, record.sense, record.drive, free=free, step=record.step, stretches=stretches)


def test_a_record_is_cut_behind_its_gaps() -> None:
    assert holed().stretches == (slice(0, 140), slice(140, 303), slice(303, N))
    calm = holed().gaps
    assert calm is not None
    still = replace(calm, spread=np.zeros_like(calm.spread))
    assert replace(holed(), gaps=still).stretches == (slice(0, N),)


def test_constants_are_found_over_gaps() -> None:
    record = holed()
    fit = refined(record, record.stretches)
    for name in ("kxx", "dxx"):
        low, high = fit.interval(name)
        assert low - 0.5 * (high - low) < TRUE[name] < high + 0.5 * (high - low)
    assert fit.rmse[0] == pytest.approx(DEVICE.noise[0], rel=0.1)
    assert refined(record, ()).rmse[0] > 20.0 * DEVICE.noise[0]


def test_the_same_as_least_squares_with_a_start_for_each_stretch() -> None:
    """By SciPy over all unknowns at once, derivatives by differences."""
    record = holed()
    fit = refined(record, record.stretches)
    names, scale = ("phi_x", "kxx", "dxx"), np.array([1e-3, 1e3, 1.0])
    told = np.isfinite(record.sense[:, 0])

    def residual(unknown: np.ndarray) -> np.ndarray:
        shared = dict(zip(names, unknown[:3] * scale, strict=True))
        starts = unknown[3:].reshape(-1, 2) * np.array([0.1, 10.0])
        parts = [
            simulate(OBSERVER, state_of(OBSERVER, **shared, drive_gain_x=1.0, x=x, vx=v), record.drive[rows]).sensed[
                :, 0
            ]
            for (x, v), rows in zip(starts, record.stretches, strict=True)
        ]
        return np.asarray((np.concatenate(parts) - record.sense[:, 0])[told] / DEVICE.noise[0])

    begin = np.concatenate([np.array([TRUE[name] for name in names]) / scale, np.zeros(6)])
    solution = least_squares(residual, begin, x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14)
    covariance = np.linalg.inv(solution.jac.T @ solution.jac)
    for place, name in enumerate(names):
        deviation = np.sqrt(covariance[place, place]) * scale[place]
        assert fit.value(name) == pytest.approx(solution.x[place] * scale[place], abs=0.02 * deviation)


def test_derivatives_are_those_beside_the_motion_behind_a_gap() -> None:
    record, state = holed(), state_of(OBSERVER, **TRUE, x=0.03, vx=5.0)
    runs = FreeRuns(OBSERVER, record.sense, record.drive, record.step, record.stretches)
    made = runs.simulate(state, sensitive=True)
    place = OBSERVER.names.index("kxx")
    more, less = state.copy(), state.copy()
    more[place], less[place] = 1.921e5, 1.919e5
    slope = (runs.simulate(more).sensed - runs.simulate(less).sensed) / 200.0
    told = runs.told[:, 0]
    np.testing.assert_allclose(
        made.sensitivity[told, 0, place], slope[told, 0], atol=2e-3 * np.max(np.abs(slope[told]))
    )
    assert not made.sensitivity[140:, 0, :2].any()


def test_a_stretch_too_short_to_tell_its_motion_does_not_count() -> None:
    record = holed()
    assert record.gaps is not None
    close = replace(record, gaps=Gaps(np.array([139, 141]), np.full((2, 2, 2), np.inf)))
    runs = FreeRuns(OBSERVER, close.sense, close.drive, close.step, close.stretches)
    assert not runs.told[140:142].any()
    assert runs.told[142:160].all()
    assert np.all(np.isnan(runs.simulate(state_of(OBSERVER, **TRUE)).sensed[140:142]))
