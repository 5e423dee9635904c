"""What a ratio to the declared number may come from: a unit that slipped, told with its factor."""

import math

import pytest

from estimator.diagnosis import Interval
from hil.bench.ratio import Path, path_of, slip


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


def path(mass_kg: float = 1e-3, **found: float) -> Path:
    blamed = [("any", {symbol: Interval(value, value, value, "1")}) for symbol, value in found.items()]
    return path_of(blamed, mass_kg)


def test_a_drive_gain_is_told_as_a_ratio() -> None:
    """A force that is declared in N and acts in m/s²: the gain that a scan finds is the mass less 1."""
    told, fault = path(hx=-0.99894, hy=-0.99894)
    assert fault
    assert told.startswith("the drive acts 0.001060 × as declared, near mass_kg = 0.001: newtons for m/s²")
    assert "[device.drive] unit" in told
    assert "IDENTITY.drive_scale_mps2" in told
    assert path(hx=0.02, hy=-0.01) == ("the drive acts 1.020 and 0.9900 × as declared", False)
    assert path(hx=1.0, hy=-0.5) == ("the drive acts 2.000 and 0.5000 × as declared", False)
    assert path(hx=0.5, hy=0.5) == ("the drive acts 1.500 × as declared", False)


def test_only_what_blames_the_path_from_drive_to_sense_says_so() -> None:
    assert path(k3x=1.0) == ("", False)
    assert path(mx=0.05, my=-0.05) == path(ex=0.02) == path(gy=0.03) == ("", False)


@pytest.mark.parametrize(
    ("found", "told"),
    [
        ({"hx": -1.0, "hy": -1.0, "mx": 1.0, "my": 1.0}, "x and y are exchanged"),
        ({"hx": -0.99, "hy": -1.02, "mx": 1.05, "my": 0.98, "gy": 0.01}, "x and y are exchanged"),
        ({"hx": -2.0, "hy": -2.0}, "x and y act the wrong way round"),
        ({"hx": -2.02, "hy": 0.0}, "x acts the wrong way round"),
        ({"gy": -1.97}, "y acts the wrong way round"),
    ],
)
def test_the_matrix_from_drive_to_sense_tells_how_the_wires_are(found: dict[str, float], told: str) -> None:
    said, fault = path(**found)
    assert fault
    assert told in said
    assert "on import" in said
    assert "× as declared" not in said


def test_an_exchange_keeps_its_signs_and_its_factor() -> None:
    told, fault = path(hx=-1.0, hy=-1.0, mx=-57.3, my=57.3)
    assert fault
    assert "x and y are exchanged" in told
    assert "x acts the wrong way round" in told
    assert "near 180/π" in told
    assert "reverses the rate" not in told
    assert "the wrong one reverses the rate" in path(hx=-1.0, hy=-1.0, mx=1.0, my=1.0).told


@pytest.mark.parametrize(
    "found",
    [
        {"hx": -1.1, "hy": 0.0},  # a drive that does next to nothing has no sign
        {"hx": -0.5, "hy": -0.5, "mx": 0.5, "my": 0.5},
        {"hx": -0.3, "hy": -0.3, "mx": 0.7, "my": -0.7},  # turned by 45°
    ],
)
def test_what_is_near_no_wiring_is_no_fault(found: dict[str, float]) -> None:
    assert not path(**found).is_fault
