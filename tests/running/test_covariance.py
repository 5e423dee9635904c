"""The whole covariance of a run, in its folder: what it is, in each mode and variant, and that it is honest."""

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from benchmarks.consistency import declared_bench, true_start, with_drawn_initial_values
from device_emulator.board import Board
from device_emulator.device import Device
from device_emulator.truth_file import TruthFile, truth_metadata
from estimator.observer import Observer
from hil.bench import override
from hil.records.runfolder import RunFolder
from hil.records.truth import read_truth
from hil.replaying.replay import replay
from hil.running.recording.tracks import column_of
from hil.scoring.nees import nees
from hil.wire.inproc import InprocLink
from hil.wire.messages import ClockMode
from tests.running import gyro
from tests.running.closed import close_loop, waiting

ENTRIES = {"sense": 7, "gyro": 11, "full": 13}
CUBIC = {"cubic_stiffness": {}}


def holds_what_the_intervals_are_from(run: RunFolder, every: int) -> None:
    """Symmetric, positive definite, its diagonal the squares of the deviations recorded with the estimates."""
    covariance, estimates, capture = run.covariance, run.estimates, run.capture
    assert covariance is not None
    assert estimates is not None
    assert capture is not None
    assert covariance.complete
    assert covariance.tick.tolist() == list(range(every - 1, len(capture), every))
    rows = np.searchsorted(estimates.tick, covariance.tick)
    np.testing.assert_array_equal(estimates.tick[rows], covariance.tick)
    for i, name in enumerate(covariance.entries):
        np.testing.assert_allclose(covariance.matrices[:, i, i], estimates.sd(name)[rows] ** 2, rtol=1e-12)
        assert covariance.units[i] == estimates.unit(name)
    for matrix in covariance.matrices:
        sd = np.sqrt(np.diag(matrix))
        assert np.linalg.eigvalsh(matrix / np.outer(sd, sd))[0] > 0.0


@pytest.mark.moderate
@pytest.mark.parametrize("gain", ["fading", "ekf", "stationary"])
@pytest.mark.parametrize("variant", list(ENTRIES))
def test_it_is_the_observers_in_force_mode(tmp_path: Path, variant: str, gain: str) -> None:
    scenario = gyro.scenario(tmp_path / "board.toml")
    declared = gyro.bench(
        0.3,
        loop={"covariance_every": 80},
        observer={"variant": variant, "gain": gain, "memory_s": 0.05},
        limits={"residual_safe": 1e9},  # 7 states on a device that is not as declared
    )
    observers: list[Observer] = []
    run, _ = close_loop(waiting(scenario), declared, tmp_path / "run", observers.append)
    holds_what_the_intervals_are_from(run, 80)
    covariance, observer = run.covariance, observers[0]
    assert covariance is not None
    assert covariance.entries == tuple(column_of(name) for name in observer.estimated)
    assert len(covariance.entries) == ENTRIES[variant]
    np.testing.assert_array_equal(covariance.matrices[-1], observer.covariance)


@pytest.mark.moderate
def test_effects_are_in_it(tmp_path: Path) -> None:
    scenario = gyro.scenario(tmp_path / "board.toml")
    declared = override(gyro.bench(0.3, loop={"covariance_every": 200}), {"effects": CUBIC}, "test")
    observers: list[Observer] = []
    run, _ = close_loop(waiting(scenario), declared, tmp_path / "run", observers.append)
    holds_what_the_intervals_are_from(run, 200)
    assert run.covariance is not None
    assert run.covariance.entries[13:] == observers[0].estimated[13:]
    assert len(run.covariance.entries) == 15
    np.testing.assert_array_equal(run.covariance.matrices[-1], observers[0].covariance)


@pytest.mark.moderate
@pytest.mark.parametrize(("block", "estimates", "every"), [(40, 8, 120), (40, 80, 160)])
def test_it_is_the_observers_in_gain_mode(tmp_path: Path, block: int, estimates: int, every: int) -> None:
    scenario = gyro.scenario(tmp_path / "board.toml")
    loop = {"mode": "gain", "block": block, "estimate_every": estimates, "covariance_every": every}
    declared = gyro.bench(0.36, loop=loop, link={"watchdog_s": 0.05})
    observers: list[Observer] = []
    run, _ = close_loop(waiting(scenario), declared, tmp_path / "run", observers.append)
    holds_what_the_intervals_are_from(run, every)
    assert run.covariance is not None
    np.testing.assert_array_equal(run.covariance.matrices[-1], observers[0].covariance)


@pytest.mark.moderate
@pytest.mark.usefixtures("no_report")
@pytest.mark.parametrize("every", [80, 1000, 40_000])
def test_a_replay_has_it_too_and_the_rest_does_not_depend_on_how_often(tmp_path: Path, every: int) -> None:
    scenario = gyro.scenario(tmp_path / "board.toml")
    declared = gyro.bench(0.5)
    run, _ = close_loop(waiting(scenario), declared, tmp_path / "run")

    def again(every: int) -> RunFolder:
        chosen = override(declared, {"loop": {"covariance_every": every}}, "test")
        return RunFolder(
            replay(run.capture_path, chosen, tmp_path / "runs", backend=None, progress=lambda _: None).folder
        )

    replayed, other = again(every), again(400)
    holds_what_the_intervals_are_from(replayed, every)
    assert replayed.estimates_path.read_bytes() == other.estimates_path.read_bytes()


def test_without_a_word_about_it_there_are_ten_a_second() -> None:
    loop = gyro.bench(0.5).loop
    assert loop.covariance_stride(4000.0) == 400
    assert loop.covariance_stride(10.0) == loop.estimate_every
    streamed = override(gyro.bench(0.5), {"loop": {"mode": "gain", "block": 160}, "link": {"watchdog_s": 0.5}}, "test")
    assert streamed.loop.covariance_stride(4000.0) == 320


@pytest.mark.long
def test_run_folders_of_many_seeds_are_consistent(tmp_path: Path) -> None:
    """Initial values from P0, the emulator's noise declared: one instant of each run, independent of all others."""
    scenario, bench = declared_bench("s-slow")
    start, seeds = true_start(scenario), 80
    found = []
    for seed in range(seeds):
        own = override(
            with_drawn_initial_values(bench, start, seed),
            {"loop": {"duration_s": 0.75, "clock": "lockstep", "covariance_every": 3000, "estimate_every": 40}},
            "test",
        )
        truth = tmp_path / f"truth-{seed}.arrow"
        file = TruthFile(truth, truth_metadata(scenario, None))
        board = Board(scenario, Device(scenario, seed, file.add), (ClockMode.LOCKSTEP,))
        run, _ = close_loop(InprocLink(board), own, tmp_path / str(seed))
        file.close()
        assert run.covariance is not None
        assert run.estimates is not None
        figure = nees(run.covariance, run.estimates, read_truth(truth), settle_s=0.0)
        assert figure is not None
        assert (figure.entries, figure.instants, figure.independent) == (13, 1, 1.0)
        found.append(figure.mean)
    low, high = chi2.ppf((0.005, 0.995), 13 * seeds) / (13 * seeds)
    assert low < np.mean(found) < high
