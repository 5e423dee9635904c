"""Numbers on the page."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.numbers import (
    count,
    counted,
    magnitude,
    percent,
    plus_minus,
    prefix_for,
    quantity,
    relative,
    share,
    significant,
    times,
    together,
    unit_for,
)


def plain(text):
    """Typeset text with ordinary spaces and minus signs."""
    return text.replace("\u202f", " ").replace("\u00a0", " ").replace("\u2212", "-")


@pytest.mark.parametrize(
    ("value", "unit", "expected"),
    [
        (2.098e-4, "rad", "210 µrad"),
        (0.0115, "deg", "11.5 mdeg"),
        (1.0, "V", "1.00 V"),
        (999.4, "Hz", "999 Hz"),
        (1000.0, "Hz", "1.00 kHz"),
        (-3.2e-7, "m", "-320 nm"),
        (0.0, "V", "0 V"),
        (float("nan"), "V", "not finite"),
    ],
)
def test_quantities_have_prefixes(value, unit, expected):
    assert plain(quantity(value, unit)) == expected


@pytest.mark.parametrize(
    ("value", "half", "expected"),
    [
        (1610718.98, 30.95, "1 610 719 ± 31"),
        (1.382301, 0.0074, "1.3823 ± 0.0074"),
        (-6.0017, 0.0078, "-6.0017 ± 0.0078"),
        (3.5531e8, 1.2e4, "(3.55310 ± 0.00012) × 10⁸"),
        (2.5e-5, 3e-7, "(2.500 ± 0.030) × 10⁻⁵"),
        (0.0, 0.5, "0.00 ± 0.50"),
        (-0.04, 25.0, "0 ± 25"),
        (12345.6, 0.0, "12345.6"),
    ],
)
def test_half_widths_set_the_digits(value, half, expected):
    assert plain(plus_minus(value, half)) == expected.replace("12345.6", plain(significant(12345.6, 6)))


def test_what_stands_beside_has_the_same_digits():
    assert plain(plus_minus(1610718.98, 30.95, beside=1610719.438)) == "1 610 719"
    assert plain(plus_minus(3.5531e8, 1.2e4, beside=3.5530001e8)) == "3.55300 × 10⁸"


@pytest.mark.parametrize(
    ("value", "digits", "expected"),
    [
        (0.99951, 3, "1.00"),
        (123456.0, 3, "123 000"),
        (9.999e7, 2, "1.0 × 10⁸"),
        (1.234e-5, 3, "1.23 × 10⁻⁵"),
        (0, 3, "0"),
    ],
)
def test_significant_digits(value, digits, expected):
    assert plain(significant(value, digits)) == expected


def test_small_ratios_and_counts():
    assert [plain(relative(value)) for value in (0.02, -0.0016, 3.27e-6, -1e-8)] == [
        "+2.00 %",
        "-0.160 %",
        "+3.27 ppm",
        "-0.0100 ppm",
    ]
    assert plain(percent(0.9512)) == "95.1 %"
    assert [plain(count(value)) for value in (0, 9999, 120000, -12345)] == ["0", "9999", "120 000", "-12 345"]
    assert [plain(share(*pair)) for pair in ((0, 10), (3, 0), (4, 120_000), (12, 8000))] == [
        "0",
        "3",
        "4 (33 ppm)",
        "12 (0.15 %)",
    ]


def test_a_standard_uncertainty_has_no_sign():
    assert [plain(magnitude(value)) for value in (1e-3, 0.02, 3.27e-6, -1e-8)] == [
        "0.100 %",
        "2.00 %",
        "3.27 ppm",
        "0.0100 ppm",
    ]


def test_a_column_has_one_prefix():
    assert [plain(text) for text in together([0.0283, 2e-4, 0.0], "rad")] == ["28.3 mrad", "0.200 mrad", "0 mrad"]
    assert [plain(text) for text in together([float("nan"), 2.0], "rad")] == ["not finite rad", "2.00 rad"]
    assert together([], "rad") == []


def test_one_thing_is_no_plural():
    assert [plain(counted(number, "sample")) for number in (0, 1, 96000)] == ["0 samples", "1 sample", "96 000 samples"]
    assert [times(number) for number in (1, 2)] == ["once", "2 times"]


@pytest.mark.parametrize(
    ("size", "unit", "expected"),
    [(-0.008545667, "V", (1e3, "mV")), (1.000211e13, "1/s²", (1e-12, "10¹² 1/s²")), (0.2, "1/s", (1.0, "1/s"))],
)
def test_a_long_number_is_told_in_another_unit(size, unit, expected):
    factor, told = unit_for(size, unit)
    assert (factor, told) == (pytest.approx(expected[0]), expected[1])


@pytest.mark.moderate
@given(st.floats(1e-14, 1e11))
def test_a_prefix_brings_a_size_between_one_and_a_thousand(size):
    factor, _ = prefix_for(size)
    assert 0.999999 <= size * factor < 1000.001
