"""The measured records themselves, where they are; they are not part of the project."""

import os
from pathlib import Path

import numpy as np
import pytest

from estimator.trace.fit import fit
from estimator.trace.free_run import TELLING, FreeRun
from estimator.trace.problem import Problem
from evaluation.measured import emps, free_decay, rate_table, silverbox
from evaluation.measured.oscillator import declared, imported, record_of
from evaluation.measured.outcome import rms

NAMED = os.environ.get("GYROHIL_DATA")
DATA = Path(NAMED) if NAMED else Path(__file__).parents[3] / "shared" / "data"


def folder(name):
    """The folder of one record, or a skipped test that says what is missing."""
    path = DATA / name
    if not path.is_dir():
        pytest.skip(f"the measured record {name} is not at {path}; say where the records are with GYROHIL_DATA")
    return path


def quiet(_line):
    pass


@pytest.mark.slow
def test_silverbox_alone_has_the_published_error_of_a_linear_model(tmp_path):
    """Free run, fitted to the training part: 6.95, 14.3 and 6.58 mV."""
    capture = imported(folder("silverbox") / "SNLS80mV.csv.gz", tmp_path, "silverbox")
    record = record_of(capture)
    train = record.part(slice(*capture.segments["train"]))
    found = fit(FreeRun(Problem(train, *declared("silverbox"))), {})
    for test, expected in (("multisine", 6.95), ("arrow", 14.3), ("arrow_no_extrapolation", 6.58)):
        of = FreeRun(Problem(record.part(slice(*capture.segments[test])), *declared("silverbox")), telling=TELLING)
        residual = of.evaluate(found.layout, found.model, derivatives=False).innovation
        assert np.isnan(residual[:50]).all()
        assert 1e3 * np.sqrt(np.nanmean(residual**2)) == pytest.approx(expected, rel=0.01), test


@pytest.mark.slow
def test_the_friction_of_emps_is_named_from_its_forces(tmp_path):
    captures = [imported(folder("emps") / name, tmp_path, "emps") for name in emps.FILES]
    trace, before, after = emps.forces(*captures)
    assert trace.after.effects == ("dry_friction", "damping_asymmetric")
    assert rms(before) == pytest.approx(9.18, abs=0.01)
    assert rms(after) < 2.0


@pytest.mark.long
def test_emps_runs_freely_from_rest_with_the_friction_of_its_first_file(tmp_path):
    """Published free runs of the second file: 2.64 mm to 96 mm; 7.75 mm of a linear model."""
    captures = [imported(folder("emps") / name, tmp_path, "emps") for name in emps.FILES]
    found, _, _ = emps.forces(*captures)
    plain, full = emps.free_runs(found, captures[0])
    assert full.physical
    assert {effect.name for _, effect in full.observer.effects} == {
        "constant_force", "dry_friction", "damping_asymmetric", "stribeck_friction"
    }  # fmt: skip
    assert full.rmse < plain.rmse
    assert 1e3 * rms(full.error_on(record_of(captures[1]), 20)) < 3.4


@pytest.mark.slow
def test_two_masses_that_are_not_equal(tmp_path):
    outcome = free_decay.measure("coupled_masses", folder("coupled_masses"), tmp_path, quiet)
    (share,) = [row for row in outcome.rows if row.unit == "%"]
    assert set(share.effects) & {"sense_gain", "nonreciprocal_stiffness"}
    assert share.after < 1.7 < share.before


@pytest.mark.slow
def test_limits_of_the_rate_sensors(tmp_path):
    rows = {row.split: row for row in rate_table.steady(folder("rate_table") / "static.csv", tmp_path, quiet)[0]}
    for sensor, before, after in (("crs03", 3.073, 0.0030), ("crs09", 3.060, 0.0044)):
        row = rows[f"{sensor} ±400 °/s"]
        assert row.before == pytest.approx(before, abs=1e-3)
        assert row.after < after
        assert {"saturation", "soft_saturation"} & set(row.effects)
        assert row.verdict == "partly explained"
    assert rows["crh02 ±400 °/s"].verdict == "unexplained"


def test_the_names_of_the_folders_are_those_of_the_rows():
    assert (silverbox.FOLDER, emps.FOLDER, rate_table.FOLDER) == ("silverbox", "emps", "rate_table")
