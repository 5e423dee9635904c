"""`covariance.arrow` and what is computed from it."""

import json
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest
from scipy.spatial.distance import mahalanobis
from scipy.stats import chi2

from hil.errors import InputError
from hil.records.estimates import Covariance, Estimates, covariance_layout, estimates_layout, packed
from hil.records.truth import read_truth
from hil.running.recording.recorder import record_here
from hil.scoring.nees import band, nees, normalised_squares
from tests.records.synthetic_run import write_truth

NAMES, UNITS = ("x_m", "rate_rad_s", "kxx_per_s2"), ("m", "rad/s", "1/s²")
RATE_HZ, EVERY = 1000.0, 10


def spd(rng, n):
    """A random covariance whose entries are decades apart, as those of positions and stiffnesses are."""
    root = rng.standard_normal((n, 2 * n))
    scale = 10.0 ** np.linspace(-7, 2, n)
    return root @ root.T * np.outer(scale, scale)


def write(folder, matrices, every=EVERY):
    layout = covariance_layout(NAMES, UNITS, tick_rate_Hz=RATE_HZ, every=every)
    with record_here(folder, {"covariance": layout}) as recording:
        for m, matrix in enumerate(matrices):
            recording["covariance"].put(every * m + every - 1, *packed(matrix))
    return folder / "covariance.arrow"


def test_it_is_read_as_it_was_written(tmp_path):
    rng = np.random.default_rng(1)
    matrices = [spd(rng, 3) for _ in range(70)]
    matrices = [(matrix + matrix.T) / 2 for matrix in matrices]
    found = Covariance.read(write(tmp_path, matrices))
    assert found.complete
    assert (found.entries, found.units) == (NAMES, UNITS)
    np.testing.assert_array_equal(found.tick, 10 * np.arange(70) + 9)
    np.testing.assert_array_equal(found.matrices, matrices)


def test_any_program_can_read_it(tmp_path):
    """By names alone: a column for each pair, its unit in the header."""
    matrix = np.arange(9.0).reshape(3, 3) + np.arange(9.0).reshape(3, 3).T
    path = write(tmp_path, [matrix])
    with pa.ipc.open_stream(str(path)) as stream:
        header = json.loads(stream.schema.metadata[b"gyrohil"])
        table = stream.read_all()
    for i, a in enumerate(NAMES):
        for j, b in enumerate(NAMES[i:], i):
            assert table.column(f"{a}*{b}").to_pylist() == [matrix[i, j]]
    assert header["columns"]["x_m*rate_rad_s"]["unit"] == "m·rad/s"
    assert "not the filter's own P" in header["meaning"]
    assert header["triangle"] == "upper, row by row, diagonal included"


def test_columns_that_are_not_the_entries_are_refused(tmp_path):
    layout = covariance_layout(NAMES, UNITS, tick_rate_Hz=RATE_HZ, every=EVERY)
    swapped = replace(layout, header={**layout.header, "entries": ["x_m", "kxx_per_s2", "rate_rad_s"]})
    path = tmp_path / "covariance.arrow"
    with record_here(tmp_path, {"covariance": swapped}) as recording:
        recording["covariance"].put(0, *packed(np.eye(3)))
    with pytest.raises(InputError, match="its columns are not those of its entries; run or replay again"):
        Covariance.read(path)


def test_squares_are_those_of_scipy():
    rng = np.random.default_rng(2)
    matrices = np.array([spd(rng, 4) for _ in range(20)])
    errors = np.array([rng.multivariate_normal(np.zeros(4), matrix) for matrix in matrices])
    expected = [
        mahalanobis(error / s, np.zeros(4), np.linalg.inv(matrix / np.outer(s, s))) ** 2
        for error, matrix in zip(errors, matrices, strict=True)
        for s in [np.sqrt(np.diag(matrix))]
    ]
    np.testing.assert_allclose(normalised_squares(errors, matrices), expected, rtol=1e-9)


def test_what_is_not_positive_definite_is_no_covariance():
    with pytest.raises(np.linalg.LinAlgError):
        normalised_squares(np.ones((1, 2)), np.array([[[1.0, 2.0], [2.0, 1.0]]]))


@pytest.mark.parametrize("degrees", [1, 13, 91.5, 5200])
def test_the_band_is_that_of_scipy(degrees):
    assert band(degrees) == pytest.approx(tuple(chi2.ppf((0.025, 0.975), degrees) / degrees))


@pytest.mark.moderate
def test_an_honest_covariance_is_in_the_band_and_a_small_one_above(tmp_path):
    """2000 independent errors of three entries, one of them without a truth: two are left."""
    rng = np.random.default_rng(3)
    n, names = 2000, ("x_m", "rate_rad_s", "k3x")
    matrix = spd(rng, 3)
    error = rng.multivariate_normal(np.zeros(3), matrix, n)
    tick = EVERY * np.arange(n) + EVERY - 1
    truth_path = tmp_path / "truth.arrow"
    wave = np.sin(0.01 * tick)
    columns = ("x_m", "vx_mps", "y_m", "vy_mps", "phi_x_V", "phi_y_V", "rate_rad_s", "angle_rad")
    write_truth(truth_path, tick, dict.fromkeys(columns, wave))
    for claimed in (1.0, 0.25):
        folder = tmp_path / str(claimed)
        folder.mkdir()
        layouts = {
            "estimates": estimates_layout(
                names, tick_rate_Hz=RATE_HZ, every=EVERY, angle=False, units={"k3x": "1"},
                header={"settings": {"gain": "fading", "memory": 1e-9}},
            ),
            "covariance": covariance_layout(names, ("m", "rad/s", "1"), tick_rate_Hz=RATE_HZ, every=EVERY),
        }  # fmt: skip
        with record_here(folder, layouts) as recording:
            for m in range(n):
                state = wave[m] + error[m]
                recording["estimates"].put(tick[m], *state, *(claimed * np.diag(matrix)) ** 0.5)
                recording["covariance"].put(tick[m], *packed(claimed * matrix))
        found = nees(
            Covariance.read(folder / "covariance.arrow"),
            Estimates.read(folder / "estimates.arrow"),
            read_truth(truth_path),
            settle_s=4.0,
        )
        assert found is not None
        assert (found.entries, found.instants, found.independent) == (2, 1600, 1600)
        low, high = found.band
        assert (low < found.mean < high) is (claimed == 1.0)
        assert found.mean * claimed == pytest.approx(1.0, abs=0.08)


@pytest.mark.parametrize(("gain", "memory", "worth"), [("ekf", 1.0, 1.0), ("fading", 2.0, 8.0), ("fading", 50.0, 1.0)])
def test_instants_of_one_run_are_not_independent(tmp_path, gain, memory, worth):
    """16 s from 4 s on: eight memories of 2 s; a plain EKF never forgets what it takes for constant."""
    tick = EVERY * np.arange(2001)
    true = {name: np.zeros(2001) for name in ("x_m", "vx_mps", "phi_x_V", "rate_rad_s", "angle_rad")}
    write_truth(tmp_path / "truth.arrow", tick, true)
    header = {"settings": {"gain": gain, "memory": memory}}
    layouts = {
        "estimates": estimates_layout(("x_m",), tick_rate_Hz=RATE_HZ, every=EVERY, angle=False, header=header),
        "covariance": covariance_layout(("x_m",), ("m",), tick_rate_Hz=RATE_HZ, every=EVERY),
    }
    with record_here(tmp_path, layouts) as recording:
        for now in tick:
            recording["estimates"].put(int(now), 2.0, 1.0)
            recording["covariance"].put(int(now), 1.0)
    found = nees(
        Covariance.read(tmp_path / "covariance.arrow"), Estimates.read(tmp_path / "estimates.arrow"),
        read_truth(tmp_path / "truth.arrow"), settle_s=4.0,
    )  # fmt: skip
    assert found is not None
    assert found.mean == pytest.approx(4.0)
    assert found.independent == pytest.approx(worth)
    assert found.band == pytest.approx(tuple(chi2.ppf((0.025, 0.975), worth) / worth))
