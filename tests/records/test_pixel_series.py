"""Long series made drawable: the same whatever parts they come in, and nothing that stands out is hidden."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from hil.report.pixel_series import PixelSeries, first_since, pixel_series, spread

ROWS = 5000


def of(values, cuts=(), since_s=-1.0, columns=90, rows=None) -> PixelSeries:
    """The course of (n, k) values, a second apart, cut into parts before those rows."""
    t = np.arange(len(values), dtype=float)
    edges = [0, *sorted(cuts), len(values)]
    parts = [(t[a:b], values[a:b]) for a, b in pairwise(edges)]
    return pixel_series(parts, (t[0], t[-1]), len(values) if rows is None else rows, since_s, columns)


def noise(columns=2):
    return np.random.default_rng(3).standard_normal((ROWS, columns)) + [5.0, -2.0][:columns]


@pytest.mark.slow
@given(st.lists(st.integers(0, ROWS), max_size=6))
def test_parts_make_no_difference(cuts):
    whole, cut = of(noise()), of(noise(), cuts)
    for name in ("t_s", "low", "high", "mean_t_s", "mean"):
        np.testing.assert_allclose(getattr(cut, name), getattr(whole, name), rtol=1e-12)
    for found, expected in zip(cut.held, whole.held, strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.slow
@given(hnp.arrays(float, st.integers(2, 400), elements=st.floats(-1e6, 1e6)), st.integers(1, 90))
def test_what_is_drawn_has_the_extremes_and_no_others(values, columns):
    found = of(values[:, None], columns=columns, rows=ROWS)
    assert found.t_s.size <= columns
    assert np.all(np.diff(found.t_s) > 0)
    assert (found.low.min(), found.high.max()) == (values.min(), values.max())
    assert np.isin(found.low, values).all()
    assert np.isin(found.high, values).all()
    t, line = found.line(0)
    assert t.size == line.size
    assert (line.min(), line.max()) == (values.min(), values.max())


def test_a_spike_of_one_sample_stays_visible():
    values = noise(1)
    values[3217] = 50.0
    found = of(values)
    column = int(np.argmax(found.high[:, 0]))
    assert found.high[column, 0] == 50.0
    assert found.t_s[column] == pytest.approx(3217, abs=ROWS / 90)
    assert found.held.size(0) == 50.0


def test_means_are_means():
    values = noise()
    found = of(values, columns=100)
    whole = values.reshape(25, -1, 2).mean(1)
    np.testing.assert_allclose(found.mean, whole, atol=0.02)  # ends of columns differ by a sample
    assert found.mean_t_s.size == 25


def test_few_samples_are_drawn_as_they_are():
    values = noise()[:700]
    found = of(values, [13, 500])
    assert not found.crowded
    np.testing.assert_array_equal(found.line(1)[1], values[:, 1])
    np.testing.assert_array_equal(found.line(0, 3.0, 1.0)[1], 3.0 * values[:, 0] + 1.0)


@pytest.mark.parametrize(("since_s", "first"), [(1234.0, 1234), (1233.5, 1234), (1e9, 0), (-1.0, 0)])
def test_figures_are_of_the_scored_window_or_of_all_where_it_never_begins(since_s, first):
    values = noise()
    held = of(values, [1000, 2000], since_s).held
    np.testing.assert_allclose(held.rms, np.sqrt(np.mean(values[first:] ** 2, axis=0)))
    np.testing.assert_allclose(held.mean, values[first:].mean(axis=0))
    np.testing.assert_array_equal(held.low, values[first:].min(axis=0))
    np.testing.assert_array_equal(held.high, values[first:].max(axis=0))
    parts = [(np.arange(ROWS, dtype=float)[a:b], values[a:b]) for a, b in ((0, 1000), (1000, ROWS))]
    np.testing.assert_array_equal(first_since(parts, since_s), values[first])


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e300])
def test_what_is_not_finite_is_not_drawn_but_counts_in_figures(bad):
    values = noise()
    values[2000:, 1] = bad
    for found in (of(values), of(values[1600:2400])):
        drawn = np.concatenate([found.low, found.high, found.mean])
        assert np.isfinite(drawn[:, 0]).all()
        assert np.isnan(drawn[:, 1]).any()
        assert np.isfinite(drawn[:, 1]).any()
        assert not np.isinf(drawn).any()
        assert np.isfinite(found.held.rms[0])
        assert not np.isfinite(found.held.rms[1])
    assert np.isnan(of(np.full((ROWS, 1), np.nan)).held.low).all()


@pytest.mark.moderate
@given(st.integers(1, 5000), st.integers(1, 300), st.integers(1, 700))
def test_a_spread_is_bounded_and_even(rows, most, step):
    values = np.arange(rows, dtype=float)
    found = spread(lambda: (values[k : k + step] for k in range(0, rows, step)), rows, most)
    assert 0 < found.size <= most
    assert found[0] == 0.0
    if rows <= most:
        np.testing.assert_array_equal(found, values)
    elif found.size > 1:
        assert np.unique(np.diff(found)).size == 1
