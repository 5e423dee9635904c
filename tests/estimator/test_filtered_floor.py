"""The noise floor of a record behind a filter is the declared one within its band, not what the filter stopped."""

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from estimator.residual.floor import noise_floor
from estimator.residual.spectrum import periodogram

RATE, HZ, NOISE, N = 1000.0, 50.0, 2.0, 40_000


@pytest.mark.parametrize("filtered", [True, False])
def test_a_floor_behind_a_filter(filtered: bool) -> None:
    """White noise of 2 behind a band-pass of 30 to 80 Hz: what is left of it, by its own rms."""
    white = NOISE * np.random.default_rng(1).standard_normal((N, 1))
    sections = butter(4, (30.0, 80.0), "bandpass", fs=RATE, output="sos")
    series = sosfiltfilt(sections, white, axis=0)
    left = float(np.std(series))
    predicted = np.full((N, 1), left)
    found = noise_floor(periodogram(series, RATE, HZ), predicted, RATE, HZ, filtered=filtered)
    if filtered:
        assert found.rms[0] == pytest.approx(left)
        assert found.source == "the declared noise, behind the record's filter"
    else:
        assert left / found.rms[0] > 100.0  # what the spectrum beside the band says
