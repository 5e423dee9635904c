"""A scan's bookkeeping: its parts, its gaps, its units, beside the same written out; and both against two runs."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from estimator.completeness import scan as scanning
from estimator.completeness.scan import COURSE, PARTS, Scan, scan
from estimator.core.following import Portion, Signatures
from estimator.core.taylor import taylor_order
from estimator.gaps import Gaps
from estimator.observer import Observer
from estimator.record import Record
from estimator.scaling import Array
from estimator.settings import Gain
from estimator.trace.experiments import EXPERIMENTS, loop_record
from estimator.trace.observed import run
from estimator.trace.problem import Problem
from estimator.trace.start import begin_about, begin_moving
from tests.estimator.test_scan import DEVICE, OMEGA0, SETTINGS
from tests.estimator.whitening import whitener

UNLIKE = replace(DEVICE, sense_gain=(-890.0, 445.0), noise=(9e-5, 4e-5))
WATCHED: dict[str, dict[str, float]] = {"drive_gain": {}, "cubic_stiffness": {}, "sense_gain": {}}


def edges(samples: int) -> list[tuple[int, int]]:
    return list(pairwise(np.linspace(0, samples, PARTS + 1).astype(int).tolist()))


@pytest.fixture(scope="module")
def record() -> Record:
    return loop_record(EXPERIMENTS[-1], UNLIKE, SETTINGS, latency=1, noise=1.0).part(slice(0, 3001))


@pytest.mark.moderate
def test_normal_equations_are_those_of_what_carrying_an_effect_does_part_by_part(record: Record) -> None:
    """N = Σ δνᵀS⁻¹δν and b = Σ δνᵀS⁻¹ν of each part, δν by two runs with a ten-thousandth of the coefficient's size."""
    seen = scan(Problem(record, UNLIKE, SETTINGS), WATCHED)
    assert seen.columns == {"drive_gain": slice(0, 2), "cubic_stiffness": slice(2, 4), "sense_gain": slice(4, 5)}
    plain = run(Observer(UNLIKE, SETTINGS), record)
    np.testing.assert_allclose(seen.innovation, plain.innovation, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(seen.deviation, plain.innovation_deviation, rtol=1e-6)
    assert seen.ratio == pytest.approx(np.sqrt(np.mean((plain.innovation / plain.innovation_deviation) ** 2)))
    white = whitener(UNLIKE, SETTINGS, record.sense, record.drive)
    for name, column, at in (("hy", "drive_gain", 1), ("k3x", "cubic_stiffness", 2), ("gy", "sense_gain", 4)):
        observer = Observer(UNLIKE, replace(SETTINGS, effects={column: {name: 1e-4 * seen.plausible[at]}}))
        observer.hold_coefficients()
        moved = np.einsum("nab,nb->na", white, run(observer, record).innovation - plain.innovation) / 1e-4
        normalised = np.einsum("nab,nb->na", white, plain.innovation)
        for part, (begin, end) in enumerate(edges(len(record))):
            rows = slice(begin, end)
            assert seen.normal[part, at, at] == pytest.approx(np.sum(moved[rows] ** 2), rel=0.02)
            size = np.sqrt(np.sum(moved[rows] ** 2) * np.sum(normalised[rows] ** 2))
            assert seen.score[part, at] == pytest.approx(np.sum(moved[rows] * normalised[rows]), abs=0.02 * size)
    np.testing.assert_array_equal(seen.normal, np.swapaxes(seen.normal, 1, 2))
    unweighed = scan(Problem(record, UNLIKE, SETTINGS), WATCHED, weighed=False)
    assert not unweighed.normal.any()
    assert not unweighed.score.any()
    np.testing.assert_array_equal(unweighed.course, seen.course)


@pytest.mark.moderate
@pytest.mark.parametrize("gain", [Gain.EKF, Gain.FADING])
@pytest.mark.parametrize("more", [{}, {"sense_delay": {}}])
def test_two_halves_of_what_is_watched_say_what_all_of_it_does(
    monkeypatch: pytest.MonkeyPatch, record: Record, gain: Gain, more: dict[str, dict[str, float]]
) -> None:
    """Each by an observer of its own, where two may work at a time; an odd number of effects and an even one."""
    lost = replace(record, sense=np.where(np.arange(len(record))[:, None] % 97 == 5, np.nan, record.sense))
    problem, watched = Problem(lost, UNLIKE, replace(SETTINGS, gain=gain)), {**WATCHED, **more}
    monkeypatch.setattr(scanning, "workers", lambda: 1)
    whole = scan(problem, watched, halves=True)
    assert len(whole.observer.effects) == len(watched)
    monkeypatch.setattr(scanning, "workers", lambda: 2)
    assert len(scan(problem, watched).observer.effects) == len(watched)
    halves = scan(problem, watched, halves=True)
    assert len(halves.observer.effects) == 2
    assert halves.columns == whole.columns
    assert np.any(whole.normal[:, 0, 4])  # of one half and the other
    for what in ("normal", "score", "plausible", "innovation", "deviation", "course"):
        np.testing.assert_array_equal(getattr(halves, what), getattr(whole, what), err_msg=what)


def test_a_scan_can_be_abandoned_before_each_of_its_parts(monkeypatch: pytest.MonkeyPatch, record: Record) -> None:
    """As Ctrl-C does; asked in the middle of the third, it reads no further."""
    asked = []

    def abandoned() -> None:
        asked.append(1)
        if len(asked) == 3:
            raise KeyboardInterrupt

    monkeypatch.setattr(scanning, "stop_if_abandoned", abandoned)
    with pytest.raises(KeyboardInterrupt):
        scan(Problem(record, UNLIKE, SETTINGS), WATCHED)
    assert len(asked) == 3 < PARTS


def test_the_plausible_size_of_a_coefficient_is_that_of_its_declaration_in_si(record: Record) -> None:
    """A gain has no unit; a cubic stiffness is one per (m s)²: plausible is 0.1 of ω² over the square of 1 A."""
    seen = scan(Problem(record, UNLIKE, SETTINGS), WATCHED)
    observer = Observer(UNLIKE, replace(SETTINGS, effects=WATCHED))
    declared = {c.name: c.plausible for _, effect in observer.effects for c in effect.coefficients}
    expected = []
    for name, plausible in declared.items():
        scale = UNLIKE.target / UNLIKE.amplitude**2 if name.startswith("k3") else 1.0
        expected.append(plausible * scale)
    np.testing.assert_allclose(seen.plausible, expected, rtol=1e-9)


@pytest.mark.moderate
def test_a_scan_about_an_earlier_pass_begins_as_it_ended(record: Record) -> None:
    """Its innovations are those of a run that begins about the same."""
    previous = Observer(UNLIKE, SETTINGS)
    run(previous, record)
    again = Observer(UNLIKE, SETTINGS)
    begin_about(again, previous)
    begin_moving(again, record)
    expected = run(again, record).innovation
    seen = scan(Problem(record, UNLIKE, SETTINGS), WATCHED, previous)
    np.testing.assert_allclose(seen.innovation, expected, rtol=1e-6, atol=1e-12)
    assert np.max(np.abs(scan(Problem(record, UNLIKE, SETTINGS), WATCHED).innovation - expected)) > 1e-6


def test_lost_samples_have_no_innovation_and_are_no_fault(record: Record) -> None:
    sense = record.sense.copy()
    sense[1000:1100] = np.nan
    seen = scan(Problem(replace(record, sense=sense), UNLIKE, SETTINGS), WATCHED)
    np.testing.assert_array_equal(np.isnan(seen.innovation), np.isnan(sense))
    assert seen.sound
    assert 0.8 < seen.ratio < 1.3


def made(**changed: Any) -> Scan:
    normal, one = np.ones((PARTS, 1, 1)), np.ones((9, 2))
    given: dict[str, Any] = {"normal": normal, "innovation": one, "deviation": one} | changed
    return Scan(
        columns={}, score=np.ones((PARTS, 1)), plausible=np.ones(1), observer=None, course=np.zeros((1, 1)), **given
    )  # type: ignore[arg-type]


def with_nan(rows: int) -> Array:
    series = np.ones((9, 2))
    series[:rows] = np.nan
    return series


@pytest.mark.parametrize(
    ("changed", "sound"),
    [
        ({}, True),
        ({"innovation": with_nan(3), "deviation": with_nan(3)}, True),  # lost
        ({"innovation": with_nan(3), "deviation": with_nan(4)}, False),
        ({"normal": np.array([[[1.0]], [[np.inf]]])}, False),
    ],
)
def test_what_diverged_has_no_meaning(changed: dict[str, Any], *, sound: bool) -> None:
    assert made(**changed).sound is sound


def test_the_ratio_is_the_rms_of_what_is_left_in_its_own_unit() -> None:
    innovation = np.array([[3.0, 8.0], [np.nan, 8.0]])
    assert made(innovation=innovation, deviation=np.array([[1.0, 4.0], [2.0, 4.0]])).ratio == pytest.approx(
        np.sqrt((9.0 + 4.0 + 4.0) / 3.0)
    )


# -- beside a kernel that only notes what it is asked -----------------------------------------------------------------


class Noted:
    """In the place of the kernels: innovations of a size a part, equations that are drawn; what it was asked."""

    def __init__(self, size: Array, samples: int) -> None:
        self.size, self.edges = size, edges(samples)
        self.asked: list[tuple[int, float]] = []
        self.rows: dict[int, list[Array]] = {}
        self.done = 0

    def __call__(self, observer: Observer, block: Portion, signatures: Signatures) -> None:
        z, rows = block.z, block.rows
        level, equations, instants = signatures.level, signatures.equations, signatures.course
        begin, self.done = self.done, self.done + len(z)
        part = next(k for k, (_, end) in enumerate(self.edges) if begin < end)
        self.asked.append((len(z), level))
        rows["nu"], rows["s"] = self.size[part], 1.0
        rows["s"][np.isnan(rows["nu"])] = 1.0
        equations[:] = np.random.default_rng(begin).standard_normal(equations.shape)
        instants += 1.0
        self.rows.setdefault(part, []).append(equations.copy())


def noted(monkeypatch: pytest.MonkeyPatch, size: Array, samples: int = 3201, **given: Any) -> tuple[Noted, Scan]:
    fake = Noted(size, samples)
    monkeypatch.setattr(scanning, "scan_block", fake)
    gaps = given.pop("gaps", None)
    settings = given.pop("settings", SETTINGS)
    plain = Record(
        np.zeros((samples, 2)), np.zeros((samples, 2, 1)), np.full(samples, 1.0 / DEVICE.sample_rate), {}, gaps
    )
    return fake, scan(Problem(plain, DEVICE, settings), WATCHED, **given)


def test_the_equations_of_a_part_are_the_products_of_its_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    fake, seen = noted(monkeypatch, np.ones(PARTS))
    declared = Observer(DEVICE, replace(SETTINGS, effects=WATCHED))
    scale = np.array([c.plausible for _, effect in declared.effects for c in effect.coefficients])
    for part in range(PARTS):
        rows = np.concatenate(fake.rows[part])
        begin, end = edges(3201)[part]
        assert len(rows) == 2 * (end - begin)
        np.testing.assert_allclose(seen.normal[part], (rows.T @ rows)[:5, :5] * np.outer(scale, scale), rtol=1e-9)
        np.testing.assert_allclose(seen.score[part], (rows.T @ rows)[:5, 5] * scale, rtol=1e-9)


def test_a_jump_is_four_times_the_usual_innovation_of_the_part_before(monkeypatch: pytest.MonkeyPatch) -> None:
    """0.455 is the median of χ² of one; what is smaller than predicted counts as predicted."""
    size = np.linspace(0.5, 6.0, PARTS)
    size[10] = np.nan  # nothing is seen there: as before
    fake, _ = noted(monkeypatch, size)
    levels = [level for _, level in fake.asked]
    expected = [4.0]
    for part in range(PARTS - 1):
        expected.append(expected[-1] if part == 10 else 4.0 * max(1.0, size[part] ** 2 / 0.455))
    np.testing.assert_allclose(levels, expected)


def test_samples_without_variance_have_no_deviation(monkeypatch: pytest.MonkeyPatch) -> None:
    _, seen = noted(monkeypatch, np.ones(PARTS))
    volts = 890.0 * DEVICE.amplitude
    np.testing.assert_allclose(seen.deviation, volts)
    np.testing.assert_allclose(np.abs(seen.innovation), volts)


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_a_drive_that_bends_within_a_step_needs_as_many_orders_more(
    monkeypatch: pytest.MonkeyPatch, degree: int
) -> None:
    monkeypatch.setattr(scanning, "scan_block", Noted(np.ones(PARTS), 3201))
    steps = np.full(3201, 1.0 / DEVICE.sample_rate)
    bent = Record(np.zeros((3201, 2)), np.zeros((3201, 2, degree + 1)), steps)
    observer = scan(Problem(bent, DEVICE, SETTINGS), WATCHED).observer
    assert int(observer.arrays.settings["order"][0]) == taylor_order(OMEGA0 / DEVICE.sample_rate) + degree


def test_a_part_is_cut_behind_its_gaps_and_where_its_course_is_read() -> None:
    """Beside the same written out sample by sample."""
    n, begin, end = 100, 20, 70
    last = np.array([5, 19, 20, 33, 34, 69, 70, 90])
    spread = np.arange(len(last))[:, None, None] * np.ones((1, 4, 4))
    record = Record(np.zeros((n, 2)), np.zeros((n, 2, 1)), np.ones(n), {}, Gaps(last, spread))
    pieces = list(scanning._uninterrupted(record, begin, end))
    assert [one[0] for one in pieces] == [begin, *(one[1] for one in pieces[:-1])]
    assert pieces[-1][1] == end
    widened = {one[1] - 1: float(one[3][0, 0]) for one in pieces if one[3] is not None}
    assert widened == {20: 2.0, 33: 3.0, 34: 4.0, 69: 5.0}  # by the number of the gap; those outside are others'
    reads = {}
    for _, stop, read, _ in pieces:
        for instant in range(*read.indices(COURSE)):
            reads[instant] = stop
    assert reads == {k: begin + int(np.ceil((k + 1) * (end - begin) / COURSE)) for k in range(COURSE)}


def test_a_part_without_gaps_is_one_piece() -> None:
    for gaps in (None, Gaps(np.array([3, 80]), np.zeros((2, 4, 4)))):
        record = Record(np.zeros((100, 2)), np.zeros((100, 2, 1)), np.ones(100), {}, gaps)
        assert list(scanning._uninterrupted(record, 20, 70)) == [(20, 70, slice(0, COURSE), None)]


def test_after_a_gap_the_motion_is_unsettled(monkeypatch: pytest.MonkeyPatch) -> None:
    spreads: list[Array] = []
    monkeypatch.setattr(Observer, "unsettle", lambda self, spread: spreads.append(spread))
    gaps = Gaps(np.array([7, 2000]), np.stack([np.eye(4), 2.0 * np.eye(4)]))
    fake, seen = noted(monkeypatch, np.ones(PARTS), gaps=gaps)
    assert [spread[0, 0] for spread in spreads] == [1.0, 2.0]
    assert sum(samples for samples, _ in fake.asked) == 3201
    factors = np.abs(seen.course).max(axis=0)  # one was added to each instant, once
    np.testing.assert_allclose(np.abs(seen.course), np.broadcast_to(factors, seen.course.shape))


@pytest.mark.moderate
def test_of_a_part_cut_by_gaps_all_rows_count(record: Record) -> None:
    """A gap that adds nothing to the motion changes nothing but the order of sums."""
    gaps = Gaps(np.array([3, 500, 501, 2222]), np.zeros((4, 4, 4)))
    whole = scan(Problem(record, UNLIKE, SETTINGS), WATCHED)
    cut = scan(Problem(replace(record, gaps=gaps), UNLIKE, SETTINGS), WATCHED)
    for name in ("normal", "score", "course"):
        one, other = getattr(whole, name), getattr(cut, name)
        np.testing.assert_allclose(other, one, atol=1e-4 * np.max(np.abs(one)))
