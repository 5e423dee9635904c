"""What a ratio to the declared number may come from: a unit that slipped, told with its factor."""

import math

import pytest

from estimator.diagnosis import Interval
from hil.bench.ratio import drive_words, of_drive, slip


@pytest.mark.parametrize(
    ("ratio", "told"),
    [
        (57.3, "180/π: degrees for radians"),
        (0.01745, "180/π: degrees for radians"),
        (6.283, "2π: hertz for rad/s"),
        (-57.3, "180/π"),
        (1000.0, "1000: a thousandth"),
        (1.06e-3, "1000: a thousandth"),
        (1e-6, "1e+06: a millionth"),
        (9.81, "9.80665: g for m/s²"),
        (2.0, "2: peak to peak"),
        (0.707, "√2: an amplitude"),
    ],
)
def test_a_slip_is_told_with_its_factor(ratio: float, told: str) -> None:
    assert slip(ratio).startswith(told)


@pytest.mark.parametrize("ratio", [1.0, 0.98, 1.2, 3.3, 0.3, 25.0, 0.0, math.nan, math.inf])
def test_what_is_no_slip_is_not_guessed_at(ratio: float) -> None:
    assert slip(ratio) == ""


def test_a_mass_of_a_kilogram_explains_nothing() -> None:
    assert slip(1.0, {"mass": 1.0}) == slip(1.02, {"mass": 1.03}) == ""
    assert slip(1 / 1.8e-7, {"mass": 1.8e-7}) == "mass"


def test_a_drive_gain_is_told_as_a_ratio() -> None:
    """A force that is declared in N and acts in m/s²: the gain that a scan finds is the mass less 1."""
    told = of_drive((-0.99894, -0.99894), 1e-3)
    assert told.startswith("the drive acts 0.001060 × as declared, near mass_kg = 0.001: newtons for m/s²")
    assert "[device.drive] unit" in told
    assert "IDENTITY.drive_scale_mps2" in told
    assert of_drive((0.02, -0.01), 1e-3) == "the drive acts 1.020 and 0.9900 × as declared"
    assert of_drive((1.0, -0.5), 1e-3) == "the drive acts 2.000 and 0.5000 × as declared"
    assert of_drive((-2.0, -2.0), 1e-3).endswith("and the other way round")


def test_only_what_blames_the_drive_says_so() -> None:
    def gains(*values: float) -> dict[str, Interval]:
        return {symbol: Interval(value, value, value, "1") for symbol, value in zip(("hx", "hy"), values, strict=True)}

    blamed = [("cubic_stiffness", {"k3x": Interval(1.0, 0.9, 1.1, "1")}), ("drive_gain", gains(0.5, 0.5))]
    assert drive_words(blamed, 1e-3) == ("the drive acts 1.500 × as declared",)
    assert drive_words(blamed[:1], 1e-3) == ()
