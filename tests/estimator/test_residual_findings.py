"""What a residual's findings say: each of them beside its own arithmetic, from measures that are given."""

import math
from dataclasses import fields, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from estimator.diagnosis import Finding, Fit
from estimator.observer import Estimates
from estimator.record import Record
from estimator.residual import analysis
from estimator.residual.dependence import Dependence
from estimator.residual.floor import Floor
from estimator.residual.significance import of_many
from estimator.residual.spectrum import Band, Line
from estimator.residual.suspects import suspects
from estimator.residual.whiteness import Whiteness
from estimator.scaling import Array

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
        assert one.points_at == suspects("floor")


def test_where_one_channel_s_floor_is_below_what_is_declared_the_size_is_a_number() -> None:
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
def test_memory_and_a_lopsided_spectrum_are_told_by_their_chances(
    monkeypatch: pytest.MonkeyPatch, off: float, *, told: bool
) -> None:
    """Of two channels the more lopsided one, and its chance that of the best of two."""
    level = math.log(SHARE)
    chances = iter([-0.1, math.log1p(-math.sqrt(1.0 - math.exp(level + off)))])  # Šidák's
    monkeypatch.setattr(analysis, "cumulative_periodogram", lambda column: Whiteness(0.0, 0.0, next(chances)))
    white = Whiteness(0.0, 0.0, level + off)
    found = analysis._of_whiteness(np.zeros((9, 2)), white, fit((3.0, 4.0), (1.0, 1.0), 1.0), SHARE)
    assert len(found) == 2 * told
    for one, text in zip(found, ("autocorrelated", "its spectrum is not flat as a whole"), strict=False):
        assert (one.kind, one.size) == ("whiteness", 5.0)
        assert one.text.startswith(text)
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
            assert (one.kind, one.size, one.points_at) == ("line", 1.0, suspects("line at 5"))
            assert one.significance == pytest.approx(stats.norm.isf(math.exp(of_many(log_p, 6))), rel=1e-6)


@pytest.mark.parametrize(
    ("offset", "says"),
    [(0.019, ""), (0.021, ", +0.021 Hz beside it"), (-0.021, ", −0.021 Hz beside it"), (0.25, ", +0.25 Hz beside it")],
)
def test_a_line_beside_a_multiple_is_told_with_its_distance_from_a_ten_thousandth_on(offset: float, says: str) -> None:
    (found,) = lines((band(1, -0.1), band(2, -0.1)), line(2, offset))
    assert found.text == f"around 2 × the resonance (400 Hz); one line, strongest at {400.0 + offset:.7g} Hz{says}"
    assert found.size == 1.0  # the band holds more than the line
    # From a thousandth on it may be another's.
    elsewhere = suspects("line elsewhere") if abs(offset) > 0.2 else ()
    assert found.points_at == suspects("line at 2") + elsewhere


def test_several_lines_around_a_multiple_are_counted_and_are_its_own() -> None:
    (found,) = lines((band(0, -0.1),), line(0, 1.5, rms=3.0), line(0, -1.5, rms=2.0))
    assert found.text == "around zero frequency (0 Hz); 2 lines, strongest at 1.5 Hz, +1.5 Hz beside it"
    assert found.size == 3.0
    assert found.points_at == suspects("line at 0")
    (first,) = lines((band(1, SURELY),))
    assert first.text == "around the resonance (200 Hz)"


def test_a_line_at_no_multiple_is_one_by_itself() -> None:
    odd = line(None, 333.0, rms=0.25)
    (found,) = lines((band(1, -0.1),), odd)
    assert found.text == "a line at 333 Hz, 1.665 × the resonance, not a multiple of it"
    assert (found.kind, found.size, found.points_at) == ("line", 0.25, suspects("line elsewhere"))
    assert found.significance == pytest.approx(stats.norm.isf(math.exp(SURELY)))
    assert lines((band(1, -0.1),), line(1, 0.0, HARDLY)) == []


# -- dependences ------------------------------------------------------------------------------------------------------


def dependence(
    regressor: str, component: str = "in phase, along", t: float = -7.25, log_p: float = -40.0
) -> Dependence:
    return Dependence(component, regressor, -3.0, t, log_p)


@pytest.mark.parametrize(
    ("regressor", "kind", "what"),
    [
        ("always", "amplitude", "is always there"),
        ("amplitude", "amplitude", "follows the amplitude"),
        ("sin 2θ", "orientation", "follows sin 2θ"),
        ("cos 4θ", "orientation", "follows cos 4θ"),
        ("rate", "rate", "follows the rate"),
        ("temperature", "temperature", "follows the temperature"),
    ],
)
def test_a_dependence_is_told_by_what_it_follows(regressor: str, kind: str, what: str) -> None:
    """A slope is that of an amplitude; its size is rms."""
    found = analysis._moves_with(dependence(regressor, "in quadrature, across"), -40.0)
    assert found.kind == kind
    assert found.text == f"at the resonance, a part in quadrature with the motion and across it {what} (t = −7.25)"
    assert found.size == pytest.approx(3.0 / math.sqrt(2.0))
    assert found.significance == pytest.approx(-stats.norm.ppf(math.exp(-40.0)), rel=1e-6)
    assert found.points_at == suspects(regressor)


def estimates(axes: int = 2, rate: bool = True, every: int = 1) -> Estimates:
    index = np.arange(every - 1, N, every)
    names = ("x", "vx", "y", "vy")[: 2 * axes] + (("rate",) if rate else ())
    state = np.random.default_rng(3).standard_normal((len(index), len(names)))
    still = dict.fromkeys((field.name for field in fields(Estimates)), np.zeros(N))
    return Estimates(**(still | {"names": names, "index": index, "state": state, "deviation": state}))


class Seen:
    """In the place of what is demodulated."""

    def __init__(self) -> None:
        self.amplitude, self.angle = np.linspace(1.0, 2.0, 50), np.linspace(0.0, 9.0, 50)
        self.components = {"in phase, along": np.zeros(50)}

    def mean(self, series: Array) -> Array:
        return 1000.0 + series[:50]


def moved(monkeypatch: pytest.MonkeyPatch, entries: tuple[Dependence, ...] = (), **given: Any) -> Any:
    """What `_of_motion` finds, and the regressors that it asks."""
    asked: dict[str, Any] = {}

    def dependences(components: dict[str, Array], regressors: dict[str, Array]) -> tuple[Dependence, ...]:
        asked.update(regressors)
        return entries

    monkeypatch.setattr(analysis.demodulation, "motion", lambda estimates, samples, cycle: None)
    monkeypatch.setattr(analysis.demodulation, "demodulate", lambda series, moving, cycle: Seen())
    monkeypatch.setattr(analysis, "dependences", dependences)
    axes, samples = given.get("axes", 2), given.get("samples", N)
    record = Record(
        np.zeros((samples, axes)), np.zeros((samples, axes, 1)), np.full(samples, 1.0 / RATE), given.get("channels", {})
    )
    of = given.get("of") or estimates(axes, given.get("rate", True))
    return analysis._of_motion(np.zeros((samples, axes)), of, record, given.get("cycle", 20.0), SHARE), asked


def test_what_is_in_step_with_the_vibration_is_asked_of_all_that_moves(monkeypatch: pytest.MonkeyPatch) -> None:
    series = np.arange(float(N))
    _, plain = moved(monkeypatch)
    assert set(plain) == {"amplitude", "sin 2θ", "cos 2θ", "sin 4θ", "cos 4θ", "rate"}
    seen = Seen()
    for order in (2, 4):
        np.testing.assert_array_equal(plain[f"sin {order}θ"], np.sin(order * seen.angle))
        np.testing.assert_array_equal(plain[f"cos {order}θ"], np.cos(order * seen.angle))
    np.testing.assert_array_equal(plain["amplitude"], seen.amplitude)
    np.testing.assert_allclose(plain["rate"], 1000.0 + estimates().of("rate")[:50])
    _, known = moved(monkeypatch, channels={"rate": series, "temperature": 2.0 * series})
    np.testing.assert_array_equal(known["rate"], 1000.0 + series[:50])  # the reference before the estimate
    np.testing.assert_array_equal(known["temperature"], 1000.0 + 2.0 * series[:50])
    _, single = moved(monkeypatch, axes=1, rate=False)
    assert set(single) == {"amplitude"}


def test_a_rate_that_was_kept_now_and_then_is_joined_by_straight_lines() -> None:
    of = estimates(every=4)
    record = Record(np.zeros((N, 2)), np.zeros((N, 2, 1)), np.full(N, 1.0 / RATE))
    series = analysis._rate(of, record)
    assert series is not None
    assert series[4] == pytest.approx(0.75 * of.of("rate")[0] + 0.25 * of.of("rate")[1])
    np.testing.assert_allclose(series[of.index], of.of("rate"))
    assert analysis._rate(estimates(rate=False), record) is None


@pytest.mark.parametrize(("cycle", "asked"), [(31.25, True), (31.26, False)])
def test_fewer_than_32_blocks_of_four_cycles_say_nothing(
    monkeypatch: pytest.MonkeyPatch, cycle: float, *, asked: bool
) -> None:
    _, regressors = moved(monkeypatch, cycle=cycle)
    assert bool(regressors) is asked


def test_without_motion_nothing_is_in_step_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    of = estimates()
    still = of.state.copy()
    still[:, 0] = 0.0
    _, regressors = moved(monkeypatch, of=replace(of, state=still))
    assert regressors == {}


def test_of_each_regressor_the_surest_component_is_told_and_its_chance_is_that_of_the_best_of_all(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    least = LEVEL - math.log(5.0)
    entries = (
        dependence("always", log_p=least + 0.01),
        dependence("amplitude", "in phase, along", log_p=-50.0),
        dependence("amplitude", "in quadrature, across", t=9.0, log_p=-60.0),
        dependence("rate", log_p=least - 0.01),
        dependence("sin 2θ", log_p=-1.0),
    )
    found, _ = moved(monkeypatch, entries)
    assert [one.kind for one in found] == ["amplitude", "rate"]
    assert "in quadrature with the motion and across it" in found[0].text
    assert found[0].significance == pytest.approx(-float(stats.norm.ppf(5.0 * math.exp(-60.0))), rel=1e-6)


def test_the_drive_is_asked_beside_the_motion_sample_by_sample(monkeypatch: pytest.MonkeyPatch) -> None:
    """The last 200 000 samples, of which those that are lost say nothing; the chance is that of the best of all."""
    asked: dict[str, Any] = {}
    entries: list[Dependence] = []

    def dependences(components: dict[str, Array], regressors: dict[str, Array]) -> tuple[Dependence, ...]:
        asked.update(components=components, regressors=regressors)
        return tuple(entries)

    monkeypatch.setattr(analysis, "dependences", dependences)
    monkeypatch.setattr(analysis, "_SET", replace(analysis._SET, regressed=3000))
    of, random = estimates(), np.random.default_rng(8)
    series, drive = random.standard_normal((N, 2)), random.standard_normal((N, 2, 1))
    series[1500, 1] = np.nan
    series[10] = np.nan
    record = Record(series, drive, np.full(N, 1.0 / RATE))
    assert analysis._of_drive(series, of, record, SHARE) == []
    rows = [k for k in range(1000, N) if k != 1500]
    assert list(asked["components"]) == ["νx", "νy"]
    assert list(asked["regressors"]) == ["x", "vx", "y", "vy", "ux", "uy"]
    for axis, name in enumerate("xy"):
        np.testing.assert_array_equal(asked["components"][f"ν{name}"], series[rows, axis])
        np.testing.assert_array_equal(asked["regressors"][f"u{name}"], drive[rows, axis, 0])
        np.testing.assert_array_equal(asked["regressors"][name], of.of(name)[rows])
    others = [Dependence("νx", name, 1.0, 1.0, -99.0) for name in ("always", "x", "vx")]
    for log_p, told in ((LEVEL - math.log(2.0) + 0.01, False), (LEVEL - math.log(2.0) - 0.01, True)):
        entries[:] = [*others, Dependence("νx", "ux", 1.0, 1.0, -0.5), Dependence("νy", "ux", -2.0, -6.5, log_p)]
        found = analysis._of_drive(series, of, record, SHARE)
        assert len(found) == told
        for one in found:
            assert one.text == "νy follows the drive ux without delay (t = −6.5)"
            assert (one.kind, one.size, one.points_at) == ("drive", 2.0, suspects("drive"))
    entries[:] = others
    assert analysis._of_drive(series, of, record, SHARE) == []
    assert analysis._of_drive(series, estimates(every=2), record, SHARE) == []  # states too far apart


def test_all_is_looked_at_with_a_seventh_of_the_chance_and_told_the_largest_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    shares: dict[str, float] = {}

    def finds(name: str, size: float) -> Any:
        def found(*given: Any) -> list[Finding]:
            shares[name] = given[-1]
            return [Finding(name, name, size, 1.0)]

        return found

    for number, name in enumerate(("level", "whiteness", "lines", "motion", "drive")):
        monkeypatch.setattr(analysis, f"_of_{name}", finds(name, float(number % 3)))
    asked: dict[str, Any] = {}

    def portmanteau(series: Array, lags: int) -> Whiteness:
        asked["lags"] = lags
        return Whiteness(0.0, 1.0, 0.0)

    def strong(spectrum: Any, rate: float, resonance: float, level: float) -> tuple[Line, ...]:
        asked.update(rate=rate, level=level)
        return ()

    monkeypatch.setattr(analysis, "portmanteau", portmanteau)
    monkeypatch.setattr(analysis, "lines", strong)
    noise = np.random.default_rng(1).standard_normal((N, 2))
    record = Record(noise, np.zeros((N, 2, 1)), np.full(N, 1.0 / RATE))
    of: Any = SimpleNamespace()
    _, found, residual = analysis.analyse(noise, np.ones((N, 2)), of, record, 200.0)
    assert [one.kind for one in found] == ["lines", "whiteness", "drive", "level", "motion"]
    assert list(shares.values()) == pytest.approx([SHARE] * 5)
    assert asked == {"lags": 40, "rate": pytest.approx(RATE), "level": pytest.approx(SHARE)}
    np.testing.assert_array_equal(residual.innovation, noise)
