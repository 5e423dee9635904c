"""Measured against model in time: a few cycles, what the model makes of them on top, what it leaves below."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from estimator.settings import ObserverSettings
from hil.records.diagnosis import to_model
from hil.records.runfolder import RunFolder
from hil.report.diagnosis.evidence import held_out_figure
from hil.report.diagnosis.material import Material as Traced
from hil.report.figures.signals import prediction_figure
from hil.report.markup import inline_svg
from hil.report.material import Material
from hil.report.theme import Drawing, drawing_style
from tests.records.synthetic_run import Options, write_run
from tests.records.test_diagnosis import DEVICE, NOISE, RATE, RESONANCE, answer, ride

CYCLE = RATE / RESONANCE


def traced(**changed: object) -> Traced:
    found = replace(answer(), **changed)  # type: ignore[arg-type]
    return Traced(found, to_model(found, record="r", bench="b"), ride(), DEVICE, ObserverSettings(), "")


def drawn(material: Traced) -> Drawing:
    with drawing_style():
        found = held_out_figure(material)
        assert found is not None
        inline_svg(found.figure, "k", found.title, found.alt)  # a warning of Matplotlib's is an error here
    return found


@pytest.mark.moderate
def test_a_few_cycles_of_the_part_held_out_before_and_after() -> None:
    material = traced()
    found = drawn(material)
    above, _, below, _ = found.figure.axes
    measured, before, after = (np.asarray(line.get_ydata()) for line in above.get_lines())
    time = np.asarray(above.get_lines()[0].get_xdata())
    assert len(time) == 6 * CYCLE
    assert time[0] > material.record.time[material.found.split]
    first = int(np.searchsorted(material.record.time, time[0]))
    rows = slice(first, first + len(time))
    np.testing.assert_allclose(measured, 1e3 * material.record.sense[rows, 0])
    for shown, residual in ((before, material.found.residual_before), (after, material.found.residual_after)):
        np.testing.assert_allclose(measured - shown, 1e3 * residual[rows, 0], atol=1e-9)
    left = np.asarray(below.get_lines()[0].get_ydata())
    assert np.std(left) == pytest.approx(1e6 * 3.0 * NOISE, rel=0.3)  # in µV
    assert found.title == "Measured and predicted"
    assert "before 2" in found.caption
    assert "part held out" in found.caption


@pytest.mark.moderate
def test_where_nothing_was_added_there_is_one_model() -> None:
    found = drawn(traced(effects=()))
    assert len(found.figure.axes[0].get_lines()) == 2
    assert "before" not in found.caption.replace("from all samples before it", "")
    assert "(line)" in found.caption


@pytest.mark.moderate
def test_what_was_traced_by_the_free_run_is_measured_against_that() -> None:
    n = 500
    before = np.full((n, 2), 5e-3)
    before[:50] = np.nan  # they set its state
    found = drawn(traced(free_run=(before, np.zeros((n, 2)))))
    assert found.title == "Measured and simulated"
    assert "before 5.00\u00a0mV rms, after 0\u00a0V rms" in found.caption
    assert "uses only the drive" in found.caption


def test_nothing_is_drawn_of_what_was_lost() -> None:
    with drawing_style():
        assert held_out_figure(traced(free_run=(np.full((9, 2), np.nan),) * 2)) is None


@pytest.mark.moderate
def test_the_end_of_a_run(tmp_path: Path) -> None:
    folder = tmp_path / "20250314-092653-bench"
    write_run(folder, Options())
    material = Material(RunFolder.open(folder))
    with drawing_style():
        found = prediction_figure(material)
    assert found is not None
    above, _, _, _ = found.figure.axes
    measured, predicted = (np.asarray(line.get_ydata()) for line in above.get_lines())
    assert material.capture is not None
    assert material.innovation is not None
    np.testing.assert_allclose(measured, 1e3 * material.capture.sense_V[-len(measured) :, 0])
    np.testing.assert_allclose(measured - predicted, 1e3 * material.innovation.nu_V[-len(measured) :, 0], atol=1e-9)
    assert found.caption.startswith("The end of the run: ")
