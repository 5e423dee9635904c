"""force.arrow and what diagnosis.json and the page say of a missing force, from one whose content is known."""

import re

import numpy as np
import pyarrow.csv as pa_csv
import pytest

from estimator.diagnosis import Interval, Verdict
from estimator.missing_force.result import Form, FormTerm, MissingForce
from estimator.settings import ObserverSettings
from hil.errors import InputError
from hil.exporting.exporter import export
from hil.records import force as records
from hil.records.diagnosis import load_diagnosis, save_diagnosis, to_model
from hil.report.diagnosis import write_report
from hil.report.diagnosis.missing_force import fast, slow
from hil.report.diagnosis.tables import force_terms
from tests.records.test_diagnosis import DEVICE, RATE, RESONANCE, N, answer, ride

OMEGA = 2.0 * np.pi * RESONANCE
COEFFICIENT = -4.0e12


def cubic() -> MissingForce:
    """c q³ along a vibration whose amplitude moves, with noise as large as the deviation says."""
    t = np.arange(N) / RATE
    swing = 1e-4 * (1.0 + 0.3 * np.sin(6.0 * t))
    x, y = swing * np.cos(OMEGA * t) * np.cos(3 * t), swing * np.cos(OMEGA * t) * np.sin(3 * t)
    position = np.stack([x, y], axis=1)
    velocity = np.gradient(position, 1.0 / RATE, axis=0)
    noise = 0.1 * np.random.default_rng(3).standard_normal((N, 2))
    there = np.ones(N, dtype=bool)
    there[100:103] = False
    unit = "1/(m²·s²)"
    term = FormTerm("q³", False, {"x": Interval(COEFFICIENT, -4.1e12, -3.9e12, unit)}, {}, {"x": ("x**3", "")})
    return MissingForce(
        0, t, position, velocity, 0.0 * position, COEFFICIENT * position**3 + noise, np.array([0.1, 0.1]), noise,
        np.array([0.1, 0.1]), None, there, 9600, Form((term,), 0.02, 3.0, 1.01),
    )  # fmt: skip


@pytest.mark.moderate
def test_the_table_says_what_the_force_is_and_leaves_lost_samples_empty(tmp_path) -> None:
    force, path = cubic(), tmp_path / "force.arrow"
    records.save_force(path, force)
    assert records.is_force(path)
    assert export(path, tmp_path / "force.csv", "csv").rows == {"force": N}
    table = pa_csv.read_csv(tmp_path / "force.csv").to_pydict()
    assert list(table) == [
        "t_s", "x_m", "y_m", "vx_mps", "vy_mps", "ux_mps2", "uy_mps2", "fx_mps2", "fx_sd_mps2", "fy_mps2", "fy_sd_mps2",
        "left_x_mps2", "left_x_sd_mps2", "left_y_mps2", "left_y_sd_mps2",
    ]  # fmt: skip
    assert table["fx_mps2"][500] == pytest.approx(force.force[500, 0])
    assert table["fx_mps2"][101] is None


def test_what_is_no_such_table_is_told_in_a_line(tmp_path) -> None:
    path = tmp_path / "some.arrow"
    path.write_bytes(b"nothing")
    assert not records.is_force(path)
    with pytest.raises(InputError, match=r"some\.arrow: cannot be read"):
        records.load_force(path)


def test_means_of_bins_lie_on_the_law_and_the_band_holds_it() -> None:
    displacement = fast(cubic(), RATE / RESONANCE)[0]
    curve = displacement.curves["x"]
    law = COEFFICIENT * curve.at**3
    assert displacement.over == "displacement"
    assert np.mean((curve.low <= law) & (law <= curve.high)) > 0.8
    assert np.max(np.abs(curve.mean - law)) < 0.1 * np.max(np.abs(law))


def test_over_what_moves_slowly_the_part_in_step_is_that_of_the_law() -> None:
    """The mean of c q³ · q over cycles is ⅜ c A⁴ along a line: with the vibration along x or y, ¾ c A³ as a force."""
    panels = {panel.over: panel for panel in slow(cubic(), RATE / RESONANCE)}
    assert set(panels) == {"orientation", "amplitude", "time"}
    stiff = panels["orientation"].curves["in step with displacement"]
    still = panels["orientation"].curves["in step with velocity"]
    assert np.max(np.abs(still.mean)) < 0.1 * np.max(np.abs(stiff.mean))
    along = np.abs(stiff.at % 90.0 - 45.0)
    assert np.mean(stiff.mean[along > 35.0]) < 1.5 * np.mean(stiff.mean[along < 10.0]) < 0.0


@pytest.mark.slow
def test_diagnosis_and_page_have_it_as_a_form(tmp_path) -> None:
    force = cubic()
    found = answer(found=False, verdict=Verdict.UNEXPLAINED)
    about = records.to_model(force)
    diagnosis = to_model(found, record="ride", bench="b", missing_force=about)
    save_diagnosis(tmp_path / "diagnosis.json", diagnosis)
    assert load_diagnosis(tmp_path / "diagnosis.json").missing_force == about
    assert about.text.startswith("the force has the form q³; 2.0% of the force is left")
    assert "cause" not in about.text
    assert force_terms(about)[0].startswith("force on x: ")
    page = write_report(tmp_path, found, diagnosis, ride(), DEVICE, ObserverSettings(), force).read_text()
    assert "The missing force, without a name" in page
    assert "The form of the missing force: coefficients, SI per unit mass" in page
    assert re.search(r"Figure \d+\. Missing force over the motion", page)
    assert re.search(r"Figure \d+\. Missing force over what moves slowly", page)


def test_why_there_is_none_is_said() -> None:
    about = records.refused("the samples are not evenly spaced")
    assert about.refused == "the samples are not evenly spaced"
    assert about.form == ()
