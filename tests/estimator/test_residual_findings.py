"""What a residual's findings say: each of them beside its own arithmetic, from measures that are given."""

import math

import numpy as np
import pytest
from scipy import stats

from estimator.diagnosis import Finding, Fit
from estimator.residual import analysis
from estimator.residual.floor import Floor
from estimator.residual.significance import of_many
from estimator.residual.spectrum import Band, Line
from estimator.residual.whiteness import Whiteness

SHARE = 0.01 / 7.0  # one of seven families of looks, of a chance of 1 % for all of them
SURE = float(stats.norm.isf(SHARE / 2.0))
RATE, N = 4000.0, 4000


def fit(rms: tuple[float, ...], floor: tuple[float, ...], ratio: float) -> Fit:
    return Fit(rms, floor, ratio, 0.5)


# -- the level --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("off", "told"), [(0.97, False), (1.03, True)])
def test_a_level_above_the_floor_is_told_where_chance_does_not_make_it(off: float, *, told: bool) -> None:
    """The square of an rms of n samples of two axes is off by √(2/2n), that of a floor by twice its own uncertainty."""
    samples, unsure = 800, 0.02
    spread = math.sqrt(2.0 / (2 * samples) + (2.0 * unsure) ** 2)
    ratio = math.sqrt(1.0 + off * SURE * spread)
    found = analysis._of_level(
        fit((3.0, 4.0), (2.0, 5.0), ratio), Floor(np.ones(2), unsure, "repeats of the drive"), np.ones((9, 2)), samples,
        SHARE,
    )  # fmt: skip
    assert len(found) == told
    for one in found:
        assert one.kind == "level"
        assert one.text == f"the innovation is {ratio:.3g} × the noise floor (repeats of the drive)"
        assert one.size == pytest.approx(math.sqrt(9.0 - 4.0))  # the second channel has nothing above its floor
        assert one.significance == pytest.approx(off * SURE)


@pytest.mark.parametrize(("off", "told"), [(0.97, False), (1.03, True)])
@pytest.mark.parametrize("source", ["the spectrum away from the resonance", "the declared noise"])
def test_a_floor_of_the_spectrum_is_held_against_the_declared_noise(off: float, source: str, *, told: bool) -> None:
    unsure, declared = 0.01, np.array([2.0, 8.0])
    over = math.sqrt(1.0 + off * SURE * 2.0 * unsure)
    deviation = np.tile(declared, (9, 1))
    deviation[:3] = 1e6  # behind a gap it is wide: the usual one counts
    deviation[8] = np.nan
    levels = tuple((over * declared).tolist())
    found = analysis._of_level(fit(levels, levels, 1.0), Floor(np.array(levels), unsure, source), deviation, 800, SHARE)
    assert len(found) == (told and source.startswith("the spectrum"))
    for one in found:
        assert one.text == f"the noise floor itself is {over:.3g} × what the declared noise gives"
        assert one.size == pytest.approx(math.sqrt((over**2 - 1.0) * 68.0))
        assert one.significance == pytest.approx(off * SURE)


def test_a_channel_below_its_declared_floor_still_has_a_size() -> None:
    levels = (3.0, 1.0)
    (found,) = analysis._of_level(
        fit(levels, levels, 1.0), Floor(np.array(levels), 0.01, "the spectrum"), np.tile([1.0, 5.0], (9, 1)), 800, SHARE
    )
    assert found.size == 0.0


def test_a_fit_is_rms_over_floor_each_and_together() -> None:
    innovation = np.array([[3.0, 8.0], [np.nan, -8.0], [-3.0, 8.0]])
    white = Whiteness(1.0, 0.25, math.log(0.25))
    said = analysis.fit_of(innovation, Floor(np.array([1.0, 4.0]), 0.0, ""), white)
    assert said.innovation_rms == pytest.approx((3.0, 8.0))
    assert said.noise_floor == (1.0, 4.0)
    assert said.ratio == pytest.approx(math.sqrt((9.0 + 4.0) / 2.0))
    assert said.whiteness_p == 0.25


def test_where_the_prediction_is_wide_the_innovation_counts_as_much_less() -> None:
    deviation = np.array([[2.0], [2.0], [8.0], [1.0], [2.0]])
    innovation = np.full((5, 1), 4.0)
    np.testing.assert_allclose(analysis._levelled(innovation, deviation)[:, 0], [4.0, 4.0, 1.0, 4.0, 4.0])


# -- whiteness --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("off", "told"), [(0.01, False), (-0.01, True)])
def test_memory_is_told_by_its_chance(off: float, *, told: bool) -> None:
    level = math.log(SHARE)
    found = analysis._of_whiteness(Whiteness(0.0, 0.0, level + off), fit((3.0, 4.0), (1.0, 1.0), 1.0), SHARE)
    assert len(found) == told
    for one in found:
        assert (one.kind, one.size) == ("whiteness", 5.0)
        assert one.text.startswith("autocorrelated")
        assert one.significance == pytest.approx(stats.norm.isf(math.exp(level + off)))


@pytest.mark.parametrize(
    ("power", "says"),
    [
        (-1.0, "= 0.1"),
        (-3.9, "= 0.00013"),
        (-4.1, "= 10⁻⁴"),
        (-29.4, "= 10⁻²⁹"),
        (-299.0, "= 10⁻²⁹⁹"),
        (-301.0, "< 10⁻³⁰⁰"),
    ],
)
def test_a_chance_is_told_as_a_number_or_as_a_power_of_ten(power: float, says: str) -> None:
    assert analysis._chance(power * math.log(10.0)) == says


# -- lines ------------------------------------------------------------------------------------------------------------


LEVEL = math.log(SHARE)
SURELY, HARDLY = LEVEL - 5.0, LEVEL + 1e-9


def band(order: int, log_p: float, rms: float = 1.0) -> Band:
    return Band(order, 200.0 * order, rms, log_p)


def line(order: int | None, offset: float, log_p: float = SURELY, rms: float = 0.5) -> Line:
    return Line(200.0 * (order or 0) + offset, rms, log_p, order, offset)


def lines(around: tuple[Band, ...], *single: Line) -> list[Finding]:
    return analysis._of_lines(around, single, 200.0, SHARE)


def test_a_band_is_told_where_the_best_of_all_bands_is_not_chance() -> None:
    around = tuple(band(order, -0.1) for order in range(5))
    for log_p, told in ((LEVEL - math.log(6.0) - 0.01, True), (LEVEL - math.log(6.0) + 0.01, False)):
        found = lines((*around, band(5, log_p)))
        assert len(found) == told
        for one in found:
            assert one.text == "around 5 × the resonance (1000 Hz)"
            assert (one.kind, one.size) == ("line", 1.0)
            assert one.significance == pytest.approx(stats.norm.isf(math.exp(of_many(log_p, 6))), rel=1e-6)


@pytest.mark.parametrize(
    ("offset", "says"),
    [(0.019, ""), (0.021, ", +0.021 Hz from it"), (-0.021, ", −0.021 Hz from it"), (0.25, ", +0.25 Hz from it")],
)
def test_a_line_beside_a_multiple_is_told_with_its_distance(offset: float, says: str) -> None:
    (found,) = lines((band(1, -0.1), band(2, -0.1)), line(2, offset))
    assert found.text == f"around 2 × the resonance (400 Hz); one line, strongest at {400.0 + offset:.7g} Hz{says}"
    assert found.size == 1.0  # the band holds more than the line


def test_several_lines_around_a_multiple_are_counted_and_are_its_own() -> None:
    (found,) = lines((band(0, -0.1),), line(0, 1.5, rms=3.0), line(0, -1.5, rms=2.0))
    assert found.text == "around zero frequency (0 Hz); 2 lines, strongest at 1.5 Hz, +1.5 Hz from it"
    assert found.size == 3.0
    (first,) = lines((band(1, SURELY),))
    assert first.text == "around the resonance (200 Hz)"


def test_a_line_at_no_multiple_is_one_by_itself() -> None:
    odd = line(None, 333.0, rms=0.25)
    (found,) = lines((band(1, -0.1),), odd)
    assert found.text == "a line at 333 Hz, 1.665 × the resonance, not a multiple of it"
    assert (found.kind, found.size) == ("line", 0.25)
    assert found.significance == pytest.approx(stats.norm.isf(math.exp(SURELY)))
    assert lines((band(1, -0.1),), line(1, 0.0, HARDLY)) == []
