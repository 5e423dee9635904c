"""Allan deviation, noise type, degrees of freedom and interval against allantools on the same data."""

import allantools
import numpy as np
import pytest
from allantools import ci
from scipy.signal import fftconvolve

from estimator.allan import deviation as allan
from estimator.allan.deviation import AllanSums, allan_deviation
from estimator.allan.freedom import degrees_of_freedom, noise_type

RATE_HZ = 100.0
HALF = np.arange(1, 60_000)  # of Kasdin's filter, Proc. IEEE 83(5), 1995
KINDS = {
    2: lambda n, g: np.diff(g.standard_normal(n + 1)),
    0: lambda n, g: g.standard_normal(n),
    -1: lambda n, g: fftconvolve(np.concatenate([[1.0], np.cumprod((HALF - 0.5) / HALF)]), g.standard_normal(n))[:n],
    -2: lambda n, g: np.cumsum(g.standard_normal(n)),
}


def rates(alpha, n=40_000, seed=3):
    return 0.01 * KINDS[alpha](n, np.random.default_rng(seed))


@pytest.mark.parametrize("alpha", KINDS)
def test_deviation_noise_and_interval(alpha):
    rate = rates(alpha)
    found = allan_deviation(rate, np.arange(rate.size), RATE_HZ)
    angle = allantools.frequency2phase(rate, RATE_HZ)
    tau, deviation, _, _ = allantools.oadev(angle, rate=RATE_HZ, data_type="phase", taus=found.tau_s)
    assert found.tau_s == pytest.approx(tau, rel=1e-12)
    assert found.deviation == pytest.approx(deviation, rel=1e-9)
    kind = alpha
    low, high = found.interval(0.95)
    for k, m in enumerate(np.round(found.tau_s * RATE_HZ).astype(int)):
        if rate.size // m + 1 >= 128:
            typed = angle[: m * (1 << 14)]  # what tells the noise: so many points from the start
            kind = min(max(ci.autocorr_noise_id(typed, m)[0], -2), 2)
        assert found.alpha[k] == kind
        if kind == 2 and angle.size - 2 * m <= 2 * m:
            continue  # allantools has no formula there
        freedom = ci.edf_greenhall(kind, 2, m, angle.size, overlapping=True)
        assert found.freedom[k] == pytest.approx(freedom, rel=1e-9)
        assert (low[k], high[k]) == pytest.approx(ci.confidence_interval(deviation[k], freedom, 0.95), rel=1e-9)
    assert found.alpha[0] == alpha


@pytest.mark.parametrize("alpha", [2, 1, 0, -1, -2])
@pytest.mark.parametrize(("m", "points"), [(1, 50), (3, 40), (10, 500), (40, 300), (200, 100_000), (5000, 17_000)])
def test_degrees_of_freedom(alpha, m, points):
    theirs = ci.edf_greenhall(alpha, 2, m, points, overlapping=True) if points - 2 * m > 2 * m or alpha < 2 else None
    if theirs is not None:
        assert degrees_of_freedom(alpha, m, points) == pytest.approx(theirs, rel=1e-9)


def test_two_clusters_of_quantisation_noise():
    """Where allantools has no formula: the variance of the estimator itself."""
    angle = np.random.default_rng(5).standard_normal((20_000, 27))
    squares = np.mean((angle[:, 20:] - 2 * angle[:, 10:-10] + angle[:, :-20]) ** 2, 1)
    assert degrees_of_freedom(2, 10, 27) == pytest.approx(2 * squares.mean() ** 2 / squares.var(), rel=0.05)


def test_long_clusters_are_taken_at_fewer_places(monkeypatch):
    """As allantools takes them from every other, fourth, … point of the angle."""
    monkeypatch.setattr(allan, "EVERY_PLACE", 64)
    rate = rates(0)
    sums = AllanSums(rate.size)
    for part in np.array_split(np.arange(rate.size), 7):
        sums.add(rate[part], part)
    found = sums.deviation(RATE_HZ)
    angle = allantools.frequency2phase(rate, RATE_HZ)
    for tau, deviation, freedom, kind in zip(found.tau_s, found.deviation, found.freedom, found.alpha, strict=True):
        m, step = round(tau * RATE_HZ), 1
        while m > 64 * step:
            step *= 2
        _, theirs, _, _ = allantools.oadev(angle[::step], rate=RATE_HZ / step, data_type="phase", taus=[tau])
        assert deviation == pytest.approx(theirs[0], rel=1e-9)
        same = ci.edf_greenhall(int(kind), 2, m // step, len(angle[::step]), overlapping=True)
        assert freedom == pytest.approx(same, rel=1e-9)


@pytest.mark.parametrize("alpha", KINDS)
def test_gaps_stay_within_the_interval(alpha):
    """A tenth of the record missing, in short gaps and in one long one: within the interval of the whole record."""
    rate = rates(alpha, 60_000)
    there = np.ones(rate.size, bool)
    for start in np.random.default_rng(8).integers(0, rate.size - 40, 60):
        there[start : start + 3] = False
    there[20_000:26_000] = False
    tick = np.flatnonzero(there)
    whole, holed = allan_deviation(rate, np.arange(rate.size), RATE_HZ), allan_deviation(rate[there], tick, RATE_HZ)
    shared = np.isin(whole.tau_s, holed.tau_s)
    low, high = (end[shared] for end in whole.interval(0.95))
    assert np.count_nonzero(shared) >= 20
    assert ((low <= holed.deviation) & (holed.deviation <= high)).mean() > 0.9


def test_noise_of_a_constant_is_nothing_to_fail_at():
    assert noise_type(np.zeros(40)) in (2, 1, 0, -1, -2)
