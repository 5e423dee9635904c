"""A gap, and the rows behind it whose prediction is wide, are in no average over the innovation: rms, floor, spectrum.

White noise of 90 µV at 4 kHz; a stall of half a second, behind which the prediction is 1,000 × as wide and decays.
"""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hil.records.estimates import WIDE, Innovation, steady, stretches, usual_sd_V
from hil.records.summary import innovation_rms, predicted_rms
from hil.report.figures.spectrum import amplitude_density_of, innovation_spectrum_figure

RATE_HZ, NOISE_V, ROWS = 4000.0, 90e-6, 40_000
GAPS = ((12_000, 2_000), (25_000, 2_000))
LINE_HZ, LINE_V = 200.0, 20e-6


def stalled(gaps: tuple[tuple[int, int], ...] = GAPS, line_V: float = 0.0) -> Innovation:
    """Ticks are left out; behind each gap the prediction is wide, and the innovation is as large as it says."""
    tick = np.arange(ROWS)
    sd = np.full(ROWS, NOISE_V)
    for first, missing in gaps:
        since = tick - (first + missing)
        sd = np.where(since >= 0, np.hypot(sd, 1000.0 * NOISE_V * np.exp(-np.maximum(since, 0) / 40.0)), sd)
    there = np.ones(ROWS, bool)
    for first, missing in gaps:
        there[first : first + missing] = False
    random = np.random.default_rng(11)
    columns: dict[str, Any] = {"tick": tick[there]}
    for axis in "xy":
        nu = sd * random.standard_normal(ROWS) + line_V * np.sin(2 * np.pi * LINE_HZ * tick / RATE_HZ)
        columns |= {f"nu_{axis}_V": nu[there].astype("f4"), f"s_{axis}_V": sd[there].astype("f4")}
    return Innovation(columns, {"tick_rate_Hz": RATE_HZ, "axes": 2, "columns": {"nu_x_V": {"unit": "V"}}}, True)


@pytest.mark.parametrize("gaps", [(), GAPS])
def test_residual_and_floor_are_those_of_the_noise(gaps: tuple[tuple[int, int], ...]) -> None:
    found = stalled(gaps)
    assert innovation_rms(found, 0.0) == pytest.approx(NOISE_V, rel=0.02)
    assert predicted_rms(found, 0.0) == pytest.approx(NOISE_V, rel=1e-3)


def test_what_is_wide_is_out_and_what_is_not_is_in() -> None:
    sd = np.array([[1.0, 1.0], [WIDE, 1.0], [1.01 * WIDE, 1.0], [1.0, 2.0], [math.nan, 1.0]])
    assert steady(sd, np.array([1.0, 1.0])).tolist() == [True, True, False, False, False]


def test_stretches_hold_every_steady_row_once_and_tell_each_gap() -> None:
    found = stalled()
    usual = usual_sd_V(found)
    assert usual is not None
    parts = list(stretches(found, usual))
    rows = sum(len(part) for part in parts if part is not None)
    assert rows == int(steady(found.sd_V, usual).sum())
    assert sum(part is None for part in parts) == len(GAPS)


def test_no_segment_lies_across_a_gap() -> None:
    """Two ramps apart by a step: across it a segment would have all frequencies."""
    tone = np.sin(2 * np.pi * 250.0 * np.arange(4096) / RATE_HZ)[:, None]
    frequency, whole = amplitude_density_of([tone], 1024, RATE_HZ)
    _, apart = amplitude_density_of([tone, None, -tone + 5.0], 1024, RATE_HZ)
    np.testing.assert_allclose(apart, whole, atol=1e-9)
    _, across = amplitude_density_of([tone, -tone + 5.0], 1024, RATE_HZ)
    far = frequency > 1000.0
    assert across[far].max() > 100.0 * apart[far].max()


def drawn(found: Innovation) -> str:
    """The figure's words."""
    material = SimpleNamespace(innovation=found, scored_innovation=lambda innovation: innovation, resonance_Hz=LINE_HZ)
    drawing = innovation_spectrum_figure(material)  # type: ignore[arg-type]
    assert drawing is not None
    return drawing.caption


@pytest.mark.parametrize("gaps", [(), GAPS])
def test_a_line_stands_above_the_floor_with_a_stall_as_without(gaps: tuple[tuple[int, int], ...]) -> None:
    assert "At f₀ the innovation stands above twice the noise floor" in drawn(stalled(gaps, LINE_V))
    assert "At none of them does the innovation stand above" in drawn(stalled(gaps))
