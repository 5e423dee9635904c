"""Replay: today's observer on yesterday's record, live or measured by others."""

from pathlib import Path

import numpy as np
import pytest

from estimator.backend import Backend
from hil.bench import Bench, examples, load_bench
from hil.errors import InputError
from hil.importing.importer import import_record
from hil.inputs.captured import drives_of, samples_of
from hil.inputs.declared import device_of
from hil.records.estimates import Estimates
from hil.records.runfolder import RunFolder
from hil.records.truth import read_truth
from hil.replaying.replay import replay
from hil.wire.messages import ClockMode
from tests.running import gyro
from tests.running.closed import HandPaced, board, close_loop, waiting

pytestmark = pytest.mark.usefixtures("no_report")

SILVERBOX = Path(__file__).parents[3] / "shared" / "data" / "silverbox" / "SNLS80mV.csv.gz"

# Live, a code is scaled in one step; in a replay it becomes volts first and is scaled then.  The roundings differ, and
# the filter carries them on: relative to the largest value of a column they stay below this.
ROUNDING = 1e-9


def replayed(capture: Path, declared: Bench, out: Path, backend: Backend | None = None) -> RunFolder:
    folder = replay(capture, declared, out, backend=backend, progress=lambda _: None).folder
    assert folder is not None
    return RunFolder(folder)


def estimates_of(run: RunFolder) -> Estimates:
    assert run.estimates is not None
    return run.estimates


def assert_same(ours: RunFolder, theirs: RunFolder, tolerance: float = ROUNDING) -> None:
    """Every column of the estimates, at every instant, and the innovation at every sample."""
    live, again = estimates_of(ours), estimates_of(theirs)
    assert np.array_equal(live.tick, again.tick)
    assert live.columns.keys() == again.columns.keys()
    for name, values in live.columns.items():
        assert np.abs(again[name] - values).max() <= tolerance * np.abs(values).max(), name
    assert ours.innovation is not None
    assert theirs.innovation is not None
    # kept in single precision
    np.testing.assert_allclose(theirs.innovation.nu_V, ours.innovation.nu_V, rtol=0.0, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("gain", ["fading", "ekf", "stationary"])
def test_a_replay_is_the_live_run_again(tmp_path: Path, gain: str) -> None:
    declared = gyro.bench(1.0, observer={"gain": gain})
    run, _ = close_loop(waiting(gyro.scenario(tmp_path / "board.toml")), declared, tmp_path / "run")
    again = replayed(run.capture_path, declared, tmp_path / "runs")
    assert_same(run, again)
    assert again.capture_path.read_bytes() == run.capture_path.read_bytes()
    assert again.result is not None
    assert (again.result.link, again.result.clock, again.result.samples) == (None, None, 4000)


@pytest.mark.slow
def test_late_answers_change_nothing_about_that(tmp_path: Path) -> None:
    """The record holds the drive that was applied, so it does not matter which one the host had sent."""
    link = HandPaced(
        board(gyro.scenario(tmp_path / "board.toml"), ClockMode.PACED),
        unheard=range(500, 3900, 17),
        stops={1500: 60},
    )
    declared = gyro.bench(1.0, "paced")
    run, counters = close_loop(link, declared, tmp_path / "run")
    assert counters.held > 200
    assert_same(run, replayed(run.capture_path, declared, tmp_path / "runs"))


@pytest.mark.slow
def test_over_lost_samples_a_replay_can_only_assume_the_drive(tmp_path: Path) -> None:
    """What the host had sent for them is not in the record.  It stays with the live run to within a few deviations."""
    link = HandPaced(board(gyro.scenario(tmp_path / "board.toml"), ClockMode.PACED), lost=range(1000, 3900, 170))
    declared = gyro.bench(1.0, "paced")
    run, counters = close_loop(link, declared, tmp_path / "run")
    assert counters.lost == 18
    again = replayed(run.capture_path, declared, tmp_path / "runs")
    live, later = estimates_of(run), estimates_of(again)
    assert again.result is not None
    assert again.result.innovation_rms == pytest.approx(again.result.noise_floor, rel=0.2)
    for name in ("rate_rad_s", "kxx_per_s2", "kyy_per_s2", "kxy_per_s2"):
        assert abs(later[name][-1] - live[name][-1]) < 4.0 * live.sd(name)[-1], name


@pytest.mark.moderate
def test_over_a_burst_the_drive_that_the_board_held_is_known(tmp_path: Path) -> None:
    """Nobody answers what was lost: but for the first interval the board held what the row behind the burst shows."""
    truth = tmp_path / "truth.arrow"
    bursts = range(1000, 3800, 200)
    lost = {first + k for first in bursts for k in range(12)}
    link = HandPaced(board(gyro.scenario(tmp_path / "board.toml"), ClockMode.PACED, truth), lost=lost)
    declared = gyro.bench(1.0, "paced")
    run, _ = close_loop(link, declared, tmp_path / "run")
    capture, true = run.capture, read_truth(truth)
    assert capture is not None
    drives = drives_of(capture, device_of(declared))
    assert drives is not None
    samples = samples_of(capture, drives)
    assert np.flatnonzero(samples.gap).tolist() == [first - samples.tick[0] for first in bursts]
    quantum = 10.0 / 32768
    acted = quantum * np.column_stack([true["ux_code"], true["uy_code"]])[np.searchsorted(true.tick, samples.tick)]
    off = np.abs(samples.drive[:, :, 0] - acted)
    known = np.ones(len(off), bool)
    known[np.flatnonzero(samples.gap)] = False
    assert off[known].max() < 1e-9
    # The interval that is assumed: mostly dither, 0.3 m/s² either way, in a drive of some m/s².
    assert np.sqrt(np.mean(off[~known] ** 2)) < 0.5
    assert np.sqrt(np.mean(acted[~known] ** 2)) > 1.0


@pytest.mark.beyond(1)
@pytest.mark.slow
@pytest.mark.parametrize("backend", ["numpy", "filterpy"])
def test_the_oracles_replay_the_same(tmp_path: Path, backend: Backend) -> None:
    declared = gyro.bench(0.25, loop={"settle_s": 0.1}, observer={"gain": "ekf"})
    run, _ = close_loop(waiting(gyro.scenario(tmp_path / "board.toml")), declared, tmp_path / "run")
    assert_same(run, replayed(run.capture_path, declared, tmp_path / "runs", backend), 1e-7)


@pytest.mark.moderate
def test_an_interrupted_record_is_replayed_as_far_as_it_goes(tmp_path: Path) -> None:
    declared = gyro.bench(1.0)
    run, _ = close_loop(waiting(gyro.scenario(tmp_path / "board.toml")), declared, tmp_path / "run")
    cut = tmp_path / "cut.arrow"
    cut.write_bytes(run.capture_path.read_bytes()[:-3000])
    result = replayed(cut, declared, tmp_path / "runs").result
    assert result is not None
    assert 1000 < result.samples < 4000
    assert (result.verdict, result.complete) == ("interrupted", False)
    assert result.reasons[0] == f"the record was interrupted: it ends after row {result.samples}, without an end marker"


@pytest.mark.moderate
@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        (
            {"sample_rate_Hz": 4200.0},
            "recorded at 4000 Hz, but [device] sample_rate_Hz = 4200; correct the bench file",
        ),
        (
            {"sense": {"unit": "px"}},
            "sensed in V, but [device.sense] unit = 'px'; set unit = \"V\" with gain and noise in it, "
            "or give its own bench file",
        ),
    ],
)
def test_a_record_of_another_device_is_refused(tmp_path: Path, changes: dict[str, object], expected: str) -> None:
    run, _ = close_loop(waiting(gyro.scenario(tmp_path / "board.toml")), gyro.bench(0.1), tmp_path / "run")
    with pytest.raises(InputError) as caught:
        replayed(run.capture_path, gyro.bench(device=changes), tmp_path / "runs")
    assert str(caught.value) == f"{run.capture_path}: {expected}"
    assert not (tmp_path / "runs").exists()


@pytest.mark.long
@pytest.mark.skipif(not SILVERBOX.exists(), reason=f"{SILVERBOX.name} is not there: fetch it from its owner")
def test_a_measured_oscillator_runs_through_the_same_code(tmp_path: Path) -> None:
    """Silverbox is linear but for its cubic spring: the linear model finds the oscillator, and that it lacks something.

    Its free-run error with a linear model is published as 7 to 14 mV rms; one step ahead has to be better.
    """
    capture = tmp_path / "silverbox.arrow"
    record = import_record(SILVERBOX, capture, map_file=examples.find("map", "silverbox"))
    assert (len(record), record.axes, record.hold) == (131_072, 1, "bandlimited")
    run = replayed(capture, load_bench(examples.find("bench", "silverbox")), tmp_path / "runs")
    result = run.result
    assert result is not None
    assert result.innovation_rms is not None
    assert 1e-3 < result.innovation_rms < 7e-3
    assert result.verdict == "failed"
    assert len(result.reasons) == 1
    assert "the model lacks something" in result.reasons[0]
    stiffness, gain = result.parameters["kxx"], result.parameters["drive_gain_x"]
    assert 60.0 < np.sqrt(stiffness.value) / (2 * np.pi) < 75.0
    assert 0.9 < gain.value / stiffness.value < 1.1  # at rest a volt gives a volt
    assert 20.0 < result.parameters["dxx"].value < 80.0
