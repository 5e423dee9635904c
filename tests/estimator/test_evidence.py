"""A scan's normal equations beside regression written out: gain, coefficients, scatter, likeness."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2

from estimator.trace.evidence import Evidence, evidence, imitations, likeness, solve

PARTS, ROWS = 8, 50
PLAUSIBLE = np.array([0.1, 2.0, 30.0])
COLUMNS = {"drive_gain": slice(0, 2), "drag": slice(2, 3)}


def scanned(truth, seed: int = 1, flips: bool = False):
    """ν = −S c + noise, as the innovations lose by a signature; S in plausible sizes. flips: c turns by parts."""
    rng = np.random.default_rng(seed)
    s = rng.standard_normal((PARTS, ROWS, 3))
    s[:, :, 2] += 0.8 * s[:, :, 0]
    signs = np.where(np.arange(PARTS) % 2, -1.0, 1.0) if flips else np.ones(PARTS)
    nu = -(s @ np.asarray(truth)) * signs[:, None] + rng.standard_normal((PARTS, ROWS))
    normal, score = np.einsum("pri,prj->pij", s, s), np.einsum("pri,pr->pi", s, nu)
    scan = SimpleNamespace(columns=COLUMNS, normal=normal, score=score, plausible=PLAUSIBLE)
    return scan, s.reshape(-1, 3), nu.ravel()


def test_each_effect_is_a_regression_by_itself():
    scan, s, nu = scanned((0.3, -0.2, 0.1))
    found = evidence(scan)
    for name, columns in COLUMNS.items():
        own = s[:, columns]
        c, rest, _, _ = np.linalg.lstsq(own, -nu, rcond=None)
        one = found[name]
        np.testing.assert_allclose(one.coefficients, c * PLAUSIBLE[columns], rtol=1e-9)
        assert one.gain == pytest.approx(float(nu @ nu - rest[0]), rel=1e-9)
        deviation = np.sqrt(np.diagonal(np.linalg.inv(own.T @ own))) * PLAUSIBLE[columns]
        np.testing.assert_allclose(one.deviation, deviation, rtol=1e-6)
        assert one.degrees == own.shape[1]
    assert list(found) == sorted(found, key=lambda name: -found[name].gain)


@pytest.mark.moderate
def test_scatter_is_one_where_noise_makes_it_and_large_where_a_coefficient_turns():
    steady = np.mean([evidence(scanned((0.3, -0.2, 0.0), seed)[0])["drive_gain"].scatter for seed in range(40)])
    assert steady == pytest.approx(1.0, abs=0.15)
    turning = evidence(scanned((1.5, -1.0, 0.0), flips=True)[0])["drive_gain"]
    assert turning.scatter > 20.0
    assert turning.significance < evidence(scanned((1.5, -1.0, 0.0))[0])["drive_gain"].significance / 10.0


def test_significance_is_that_of_chi_square_with_the_scatter_taken_off():
    one = evidence(scanned((0.9, 0.0, 0.0))[0])["drive_gain"]
    expected = -chi2.logsf(one.gain / max(one.scatter, 1.0), 2) / np.log(10.0)
    assert one.significance == pytest.approx(expected)


def test_likeness_is_the_correlation_of_a_signature_with_what_the_other_can_make_of_it():
    scan, s, _ = scanned((0.3, -0.2, 0.1))
    given = np.array([0.07, 0.4])
    signature = s[:, :2] @ (given / PLAUSIBLE[:2])
    other = s[:, 2]
    expected = abs(signature @ other) / np.linalg.norm(signature) / np.linalg.norm(other)
    assert likeness(scan, "drive_gain", given) == {"drag": pytest.approx(expected)}
    found = evidence(scan)["drive_gain"].coefficients
    assert likeness(scan, "drive_gain") == {"drag": pytest.approx(likeness(scan, "drive_gain", found)["drag"])}
    assert likeness(scan, "drive_gain", 1e-9 * np.array(given)) == {"drag": pytest.approx(expected)}  # however small


@pytest.mark.parametrize("unit", [1e-12, 1.0, 1e12])
def test_what_rounding_leaves_is_no_direction_in_whatever_unit(unit: float) -> None:
    """A billionth of the largest information is the least: in tenths of that, or ten times it."""
    for least, directions in ((1e-10, 1), (1e-8, 2)):
        c, degrees = solve(unit * np.diag([1.0, least]), unit * np.array([3.0, least]))
        assert degrees == directions
        assert c == pytest.approx([3.0, 1.0 if directions == 2 else 0.0])


def test_a_direction_that_the_record_says_nothing_of_is_left_out():
    c, degrees = solve(np.diag([4.0, 0.0]), np.array([2.0, 0.0]))
    assert degrees == 1
    np.testing.assert_allclose(c, [0.5, 0.0])


def test_a_gain_that_scatters_as_noise_does_is_exact_and_a_loss_has_no_error():
    def one(gain, scatter):
        return Evidence("a", gain, 2, scatter, np.zeros(2), np.ones(2))

    assert one(100.0, 5.0).error == pytest.approx(2.0 * np.sqrt(4.0 * 100.0))
    assert one(100.0, 0.9).error == 0.0
    assert one(-3.0, 5.0).error == 0.0
    assert one(0.25, 1.25).error == pytest.approx(2.0 * np.sqrt(0.25 * 0.25))
    assert one(0.0, 0.5).significance == 0.0
    for scatter in (0.5, 1.0):  # what scatters by less than noise is no surer for it
        assert one(20.0, scatter).significance == pytest.approx(-np.log10(chi2.sf(20.0, 2)))


def test_scatter_is_per_degree_of_freedom_that_the_parts_have_more_than_the_whole():
    scan, s, nu = scanned((0.3, -0.2, 0.1))
    for name, columns in COLUMNS.items():
        own = s[:, columns]
        c = np.linalg.lstsq(own, -nu, rcond=None)[0]
        left = (nu + own @ c).reshape(PARTS, ROWS)
        parts = own.reshape(PARTS, ROWS, -1)
        misfit = 0.0
        for part, rest in zip(parts, left, strict=True):
            shift = np.linalg.lstsq(part, rest, rcond=None)[0]
            misfit += np.sum(rest**2) - np.sum((rest - part @ shift) ** 2)
        freedom = own.shape[1] * (PARTS - 1)
        assert evidence(scan)[name].scatter == pytest.approx(misfit / freedom, rel=1e-9)


def test_where_one_part_alone_says_something_nothing_can_scatter():
    scan, _, _ = scanned((0.3, -0.2, 0.1))
    scan.normal[1:], scan.score[1:] = 0.0, 0.0
    found = evidence(scan)["drive_gain"]
    assert found.degrees == 2
    assert found.scatter == pytest.approx(0.0, abs=1e-9)
    scan.normal[:], scan.score[:] = 0.0, 0.0
    none = evidence(scan)["drive_gain"]
    assert (none.gain, none.degrees, none.scatter) == (0.0, 0, 0.0)
    assert np.all(np.isfinite(none.deviation))


@pytest.mark.parametrize("lost", [np.nan, np.inf])
def test_what_the_scan_could_not_follow_has_no_evidence_and_the_others_theirs(lost: float):
    """An observer that diverges overflows in what one effect is watched by; that is no word about the rest."""
    scan, _, _ = scanned((0.3, -0.2, 0.1))
    whole, alike = evidence(scan), likeness(scan, "drive_gain")
    assert "drag" in alike
    scan.normal[3, 2, :] = scan.normal[3, :, 2] = lost
    found = evidence(scan)
    assert list(found) == ["drive_gain"]
    assert found["drive_gain"].gain == whole["drive_gain"].gain
    assert likeness(scan, "drive_gain") == {}
    scan.normal[3, 2, :] = scan.normal[3, :, 2] = 1.0
    scan.score[2, 2] = lost
    assert list(evidence(scan)) == ["drive_gain"]


@pytest.mark.parametrize("begin", [0, 3])
def test_what_an_imitation_leaves_is_a_regression_of_the_signature(begin: int) -> None:
    """By NumPy: of S c the part that the other's columns cannot make; of coefficients in SI, and of the parts asked."""
    scan, s, _ = scanned((0.3, -0.2, 0.1))
    s = s[begin * ROWS :]
    given = np.array([0.2, -0.7])  # plausible sizes
    signature = s[:, :2] @ given
    _, left, _, _ = np.linalg.lstsq(s[:, 2:], signature, rcond=None)
    found = imitations(scan, "drive_gain", given * PLAUSIBLE[:2], begin=begin)["drag"]
    assert found.size == pytest.approx(signature @ signature)
    assert found.left == pytest.approx(float(left[0]))
    assert found.likeness == pytest.approx(np.sqrt(1.0 - left[0] / (signature @ signature)))
    moved = given + np.array([0.4, 0.3])
    of_moved = np.linalg.lstsq(s[:, 2:], s[:, :2] @ moved, rcond=None)[1]
    assert (moved * PLAUSIBLE[:2]) @ found.form @ (moved * PLAUSIBLE[:2]) == pytest.approx(float(of_moved[0]))
