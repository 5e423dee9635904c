"""What is kept of an examination for the figures."""

from dataclasses import dataclass, field, fields, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from estimator.diagnosis import Fit
from estimator.errors import DivergedError
from estimator.observer import Estimates
from estimator.record import Record
from estimator.scaling import Array
from estimator.settings import ObserverSettings
from estimator.trace import examination
from estimator.trace.examination import Examination, examine, scored
from estimator.trace.problem import Problem
from tests.estimator.device import NOMINAL

N, SPLIT = 1003, 600
RATE = 4000.0


@dataclass
class Bench:
    """An observer of which sample n has the innovation n, its free runs, and what was asked."""

    free: Array = field(default_factory=lambda: np.full((N, 2), 5.0))
    lost: slice = field(default_factory=lambda: slice(0, 0))
    lost_of_x: slice = field(default_factory=lambda: slice(0, 0))
    every: int | None = None
    analysed: list[Any] = field(default_factory=list)

    def run(self, observer: object, record: Record, every: int) -> Estimates:
        """With as many states as were asked for."""
        self.every = every
        n = np.arange(float(len(record)))
        series = np.stack([n, n], axis=1)
        series[self.lost] = np.nan
        series[self.lost_of_x, 0] = np.nan
        index = np.arange(every - 1, len(record), every)
        state = index[:, None].astype(float)
        kept = {"innovation": series, "innovation_deviation": np.ones_like(series), "index": index, "names": ("rate",)}
        rest = {one.name: n for one in fields(Estimates)}
        return Estimates(**(rest | kept | {"state": state, "deviation": state}))

    def analyse(self, innovation: Array, deviation: Array, record: Record, hz: float) -> Any:
        """Notes the rows, and the record's own."""
        self.analysed.append((innovation[:, 0], record.sense[:, 0], hz))
        return Fit((1.0,), (1.0,), 1.0, 0.5), ("finding",)


def examined(monkeypatch: pytest.MonkeyPatch, bench: Bench, hz: float = 130.0, states: int = N - 1) -> Examination:
    observer = SimpleNamespace(hold_coefficients=lambda: None)
    monkeypatch.setattr(examination, "Observer", lambda *given: observer)
    monkeypatch.setattr(examination, "run", bench.run)
    monkeypatch.setattr(examination, "analyse", bench.analyse)
    monkeypatch.setattr(examination, "free_run_error", lambda problem, split: bench.free)
    monkeypatch.setattr(examination, "STATES", states)
    target = (2.0 * np.pi * hz) ** 2
    device = replace(NOMINAL, stiffness=(target, target, 0.0))
    n = np.arange(float(N))
    record = Record(np.stack([n, n], axis=1), np.zeros((N, 2, 1)), np.full(N, 1.0 / RATE), {"rate": n / 7.0})
    return examine(Problem(record, device, ObserverSettings(memory=0.0117)), SPLIT)


def test_a_long_record_keeps_four_states_a_cycle_in_whole_strides(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """30.8 samples a cycle: every seventh; the start of 140.4 samples, the split and the end on whole strides."""
    bench = Bench()
    found = examined(monkeypatch, bench)
    assert bench.every == 7
    assert found.settled == slice(140, 595)
    n = np.arange(float(N))
    for (innovation, sense, hz), first, last in zip(bench.analysed, (140, 595), (595, 1001), strict=True):
        np.testing.assert_array_equal(innovation, n[first:last])
        np.testing.assert_array_equal(sense, n[first:last])
        assert hz == pytest.approx(130.0)
    assert found.findings == ("finding",)
    # The rate is read at the samples whose state is kept, there n against a seventh of it.
    for fit, first, last in ((found.fitted, 140, 595), (found.held_out, 595, 1001)):
        rates = np.arange(first + 6, last, 7)
        assert fit.rate_error_rms == pytest.approx(np.sqrt(np.mean((rates * 6.0 / 7.0) ** 2)))


@pytest.mark.parametrize(
    ("hz", "states", "every"), [(130.0, N, 1), (999.0, N - 1, 1), (1500.0, N - 1, 1), (490.0, N - 1, 2)]
)
def test_every_state_is_kept_of_a_short_record_and_where_a_cycle_has_few(
    monkeypatch: pytest.MonkeyPatch, hz: float, states: int, every: int
) -> None:
    bench = Bench()
    examined(monkeypatch, bench, hz, states)
    assert bench.every == every


def test_free_runs_are_told_of_each_part_by_the_samples_that_they_have(monkeypatch: pytest.MonkeyPatch) -> None:
    free = np.full((N, 2), np.nan)
    free[300:400] = [3.0, 4.0]
    found = examined(monkeypatch, Bench(free))
    assert (found.fitted.simulation_rmse, found.held_out.simulation_rmse) == (pytest.approx(np.sqrt(12.5)), None)


@pytest.mark.parametrize(
    ("lost", "diverges"), [(slice(140, 595), True), (slice(595, N), True), (slice(140, 594), False)]
)
def test_an_observer_without_a_number_in_either_part_diverges(
    monkeypatch: pytest.MonkeyPatch, lost: slice, diverges: bool
) -> None:
    """A single sample of both axes is enough."""
    if diverges:
        with pytest.raises(DivergedError):
            examined(monkeypatch, Bench(lost=lost))
    else:
        examined(monkeypatch, Bench(lost=lost))


def test_samples_of_one_axis_alone_are_no_number(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(DivergedError):
        examined(monkeypatch, Bench(lost_of_x=slice(595, N)))


def test_without_a_rate_there_are_no_errors_of_the_rate() -> None:
    fit = Fit((1.0,), (1.0,), 1.0, 0.5)
    record = Record(np.zeros((9, 2)), np.zeros((9, 2, 1)), np.ones(9))
    assert scored(fit, record, Bench().run(None, record, 1), slice(0, 9), 1) is fit


def test_of_a_gyro_its_own_bias_scale_and_delay_are_no_error() -> None:
    """A bias of 10 mrad/s, a scale 1 % off and 5 ms late make 11 mrad; what is left is of the estimates."""
    t_s = np.arange(20_000) / RATE
    turning, turned = np.sin(3.0 * t_s), (1.0 - np.cos(3.0 * t_s)) / 3.0
    wrong = 2e-3 * np.sin(50.0 * t_s)
    late = 0.01 + 1.01 * np.sin(3.0 * (t_s - 5e-3))
    found = {one.name: t_s for one in fields(Estimates)}
    found |= {"names": ("rate",), "index": np.arange(len(t_s)), "angle": turned + wrong, "state": turning[:, None]}
    errors = {
        name: scored(
            Fit((1.0,), (1.0,), 1.0, 0.5),
            Record(np.zeros((len(t_s), 2)), np.zeros((len(t_s), 2, 1)), np.full(len(t_s), 1.0 / RATE), {name: late}),
            Estimates(**found), slice(4000, len(t_s)), 1,
        ).angle_error_rms for name in ("rate", "gyro")
    }  # fmt: skip
    assert errors["gyro"] == pytest.approx(2e-3 / np.sqrt(2.0), rel=0.01)
    assert errors["rate"] > 5.0 * errors["gyro"]
