"""Series of the library: their columns in degrees."""

import numpy as np
import pytest

from hil.library.series import Series


def test_a_series_in_degrees_has_their_names_and_units() -> None:
    radians = Series(
        np.array([0.0, 1.0]),
        {"rate_rad_s": np.array([np.pi, 0.0]), "sd_rate_rad_s": np.array([0.1, 0.2]), "valid": np.array([True, False])},
        {"rate_rad_s": "rad/s", "sd_rate_rad_s": "rad/s", "valid": ""},
    )
    degrees = radians.in_degrees()
    assert degrees.columns == ("rate_dps", "sd_rate_dps", "valid")
    assert degrees.unit == "°/s"
    assert degrees.values == pytest.approx([180.0, 0.0])
    assert degrees["sd_rate_dps"] == pytest.approx([5.729577951308232, 11.459155902616464])
    assert degrees["valid"].tolist() == [True, False]
