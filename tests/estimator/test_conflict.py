"""A constant that takes up an effect: what is declared of it tells (docs/reference/trace.md).

The records are those of a rate gyro whose x is held and whose y is damped by its drive, in closed form: between two
samples the drive is held, and the motion is that of a linear system.
"""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from estimator.diagnosis import Verdict
from estimator.record import Record
from estimator.settings import Device, ObserverSettings, ProcessNoise, Spread
from estimator.thresholds import THRESHOLDS
from estimator.trace import conflict
from estimator.trace.conflict import runs_backwards
from estimator.trace.engine import Round
from estimator.trace.problem import Problem
from estimator.trace.promises import Constant
from estimator.trace.selection import Selection
from estimator.trace.tracing import trace

RATE, N = 4000.0, 24_000
DEVICE = Device(
    sample_rate=RATE,
    stiffness=(1.6e6, 1.62e6, -1.2e4),
    damping=(0.8, 0.8, 0.0),
    amplitude=1e-5,
    sense_gain=(3e4, 3e4),
    noise=(2.5e-4, 2.5e-4),
)
SETTINGS = ObserverSettings(
    memory=1.0, spread=Spread(rate=0.2, stiffness=0.005, damping=1.0), process_noise=ProcessNoise(rate=2e-4)
)
DAMPED = 40.0
"""Times its own damping, that of y by its drive."""


def record(gain_y: float) -> Record:
    """`gain_y`: of the drive of y, relative to the declared one."""
    kxx, kyy, kxy = DEVICE.stiffness
    d = DEVICE.damping[0]
    free = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.array([[kxx, kxy], [kxy, kyy]]), -d * np.eye(2)]])
    driven = np.zeros((6, 6))
    driven[:4, :4] = free
    driven[2:4, 4:] = np.diag([1.0, gain_y])
    step = expm(driven / RATE)
    random = np.random.default_rng(3)
    state = np.array([DEVICE.amplitude, 0.0, 0.0, 0.0])
    motion, drive = np.zeros((N, 2)), np.zeros((N, 2))
    for tick in range(N):
        motion[tick] = state[:2]
        drive[tick] = d * state[2], -DAMPED * d * state[3]
        state = step[:4] @ np.concatenate([state, drive[tick]])
    sense = motion * DEVICE.sense_gain + random.standard_normal((N, 2)) * DEVICE.noise
    # row n holds what was sensed at its end, and the drive of the interval before
    return Record(sense[1:], drive[:-1, :, None], np.full(N - 1, 1.0 / RATE))


@pytest.mark.long
@pytest.mark.timeout(900)  # a whole trace
def test_a_damping_below_zero_is_a_drive_that_is_weaker_than_declared() -> None:
    said = trace(Problem(record(0.85), DEVICE, SETTINGS), split=round(0.6 * N))
    assert said.verdict is Verdict.PARTLY
    assert [effect.name for effect in said.effects] == ["drive_gain"]
    hy = said.effects[0].coefficients["hy"]
    assert hy.low < -0.15 < hy.high
    assert hy.high - hy.low < 0.1
    assert any(reason.startswith("dyy comes out negative") for reason in said.reasons)


@pytest.mark.slow
@pytest.mark.timeout(900)  # a whole trace
def test_a_drive_that_is_as_declared_leaves_the_damping_what_it_is() -> None:
    assert trace(Problem(record(1.0), DEVICE, SETTINGS), split=round(0.6 * N)).verdict is Verdict.ADEQUATE


def damping(name: str, value: float, declared: float = 200.0) -> Constant:
    return Constant(name, value, value - 2.0, value + 2.0, declared, 60.0, positive=True)


@pytest.mark.parametrize(
    ("dxx", "dyy", "said"),
    [
        (-281.0, -270.0, True),
        (-281.0, 270.0, False),
        (281.0, 270.0, False),
        (-281.0, -900.0, False),
        (-1.0, -270.0, False),  # the sign of one is not sure
    ],
)
def test_a_record_in_reverse_order_has_the_damping_of_both_axes_with_the_other_sign(
    dxx: float, dyy: float, *, said: bool
) -> None:
    told = runs_backwards((damping("dxx", dxx), damping("dyy", dyy), damping("kxx", 1.0)))
    assert (told is not None) is said
    assert runs_backwards((damping("dyy", dyy), damping("kxx", 1.0))) is None  # of one axis


# -- who lets the constants be as declared, of models by stubs -------------------------------------------------------


GAINS = {"drive_gain": 300.0, "sense_gain": 297.0, "drag": 293.0, "dry_friction": 900.0, "sense_delay": 20.0}
"""Of twice the log-likelihood, in a first pass."""
WATCHED: dict[str, dict[str, float]] = {
    "drive_gain": {}, "sense_gain": {}, "drag": {}, "dry_friction": {"v0": 1.0}, "dry_friction:2": {"v0": 2.0},
    "sense_delay": {},
}  # fmt: skip
SAMPLES = 500


@pytest.fixture
def reconciled(monkeypatch: pytest.MonkeyPatch) -> Any:
    """What is found where these still have a constant in conflict, and what was fitted."""

    def run(in_conflict: set[str], gains: dict[str, float] = GAINS) -> Any:
        asked: list[tuple[tuple[str, ...], int]] = []
        told: list[tuple[str, int, int]] = []

        def fit(problem: Problem, passes: int) -> Any:
            assert (len(problem.record), problem.record.step[0]) == (SAMPLES, 1 / RATE)
            asked.append((tuple(problem.effects), passes))
            own = [name for name in problem.effects if name != "known"]
            likelihood = 1000.0 + sum(gains[name] for name in own)
            return SimpleNamespace(
                likelihood=likelihood, observer=SimpleNamespace(effects=dict(problem.effects)), own=own,
                estimates=SimpleNamespace(innovation=np.zeros((SAMPLES, 2))),
            )  # fmt: skip

        def constants(problem: Problem, model: Any) -> Any:
            off = 100.0 if in_conflict & set(model.own) else 1.0
            return (Constant("kxy", 0.0, 0.0, 0.0, 0.0, 1.0), Constant("dyy", off, off, off, 0.0, 1.0))

        monkeypatch.setattr(conflict, "fit", fit)
        monkeypatch.setattr(conflict, "constants_of", constants)
        monkeypatch.setattr(conflict, "coefficients_of", lambda observer: dict(observer.effects))
        monkeypatch.setattr(conflict, "parameters_of", lambda model, name: {"of": name})
        earlier, look = SimpleNamespace(watched={"gone": {}}), SimpleNamespace(watched=WATCHED)
        none: Any = {}
        selection = Selection(
            effects={"known": {}}, rounds=(*(2 * [Round(earlier, (), None)]), Round(look, (), None)),
            alike=none, rivals=none, accounts=none,
            before=none, after=none, gain=none, searched=none, patchwork=False,
        )  # fmt: skip
        # Of the samples on which candidates are compared, which are the first.
        longer = SAMPLES + 7
        record = Record(np.zeros((longer, 2)), np.zeros((longer, 2, 1)), np.arange(1.0, longer + 1.0) / RATE)
        problem = Problem(record, DEVICE, replace(SETTINGS, effects={"known": {}}))
        choice = replace(THRESHOLDS.choice, compared=SAMPLES)
        monkeypatch.setattr(conflict, "THRESHOLDS", replace(THRESHOLDS, choice=choice))
        found = conflict.reconciled(problem, selection, lambda *what: told.append(what))
        return found, asked, told

    return run


def test_of_those_that_end_the_conflict_the_one_that_gains_most_for_its_price_acts_so(reconciled: Any) -> None:
    """A sense gain of one axis has one number less to pay for, ln 1000 = 6.9, than a drive gain of two."""
    (name, found), asked, told = reconciled({"dry_friction"})
    assert name == "sense_gain"
    assert set(found.effects) == {"known", "sense_gain"}
    assert found.gain == {"sense_gain": 297.0}
    assert found.rounds[-1].taken == "sense_gain"
    assert len(found.rounds) == 4
    # One of each kind beside what is carried, in a first pass.
    kinds = ["drive_gain", "sense_gain", "drag", "dry_friction", "sense_delay"]
    assert asked == [(("known",), 1), *((("known", kind), 1) for kind in kinds)]
    assert told[-1] == ("conflict", 6, 6)
    # Behind by 3.9 and 10.9; odds of 20 to 1 are 6.
    price = np.log(2 * SAMPLES)
    (rival,) = found.rivals["sense_gain"].items()
    assert (rival[0], rival[1].deficit) == ("drive_gain", pytest.approx(price - 3.0))
    assert rival[1].parameters == {"of": "drive_gain"}
    accounts = {one.name: one.deficit for one in found.accounts["sense_gain"]}
    assert accounts == {
        "sense_gain": 0.0,
        "nothing": pytest.approx(297.0 - price),
        "drive_gain": pytest.approx(price - 3.0),
        "drag": pytest.approx(price + 4.0),
    }


def test_what_is_behind_by_odds_of_twenty_to_one_is_told_from_the_best(
    monkeypatch: pytest.MonkeyPatch, reconciled: Any
) -> None:
    monkeypatch.setattr(conflict, "TIE", 7.0)
    behind = {"drive_gain": 300.0, "drag": 293.0}
    (_, found), *_ = reconciled(set(GAINS) - set(behind), GAINS | behind)
    assert found.rivals == {"drive_gain": {}}
    behind["drag"] = 293.5
    (_, found), *_ = reconciled(set(GAINS) - set(behind), GAINS | behind)
    assert found.rivals["drive_gain"]["drag"].deficit == pytest.approx(6.5)
    assert found.rivals["drive_gain"]["drag"].bound == 7.0


def test_what_gains_no_more_than_chance_lets_nothing_be(reconciled: Any) -> None:
    """−2 ln(10⁻⁴/5) = 21.6 for one of five with two coefficients."""
    every = set(GAINS)
    assert reconciled(every)[0] is None
    assert reconciled(every - {"sense_delay"})[0] is None
    assert reconciled(every - {"sense_delay"}, GAINS | {"sense_delay": 21.7})[0][0] == "sense_delay"


def test_what_gains_as_much_as_chance_gives_lets_nothing_be(monkeypatch: pytest.MonkeyPatch, reconciled: Any) -> None:
    monkeypatch.setattr(conflict, "chance_gain", lambda degrees, candidates: 10.0 * degrees)
    others = set(GAINS) - {"sense_delay"}
    assert reconciled(others, GAINS | {"sense_delay": 20.0})[0] is None
    assert reconciled(others, GAINS | {"sense_delay": 20.5})[0][0] == "sense_delay"


def test_what_friction_would_let_be_is_told_of_it(reconciled: Any) -> None:
    (name, found), _, _ = reconciled(set())
    assert (name, set(found.rivals["dry_friction"])) == ("dry_friction", set())


def test_a_damping_whose_interval_reaches_zero_does_not_drive() -> None:
    sure = Constant("dxx", -1.0, -1.4, -0.6, 1.0, 0.2)
    for high, told in ((-0.6, True), (0.0, False)):
        other = Constant("dyy", -1.0, -1.4, high, 1.0, 0.2)
        assert (runs_backwards((sure, other)) is not None) is told
    far = Constant("dyy", -3.0, -3.1, -2.9, 1.0, 0.2)  # of the other sign it is not the declared one either
    assert runs_backwards((sure, far)) is None
    skewed = Constant("dyy", -1.0, -9.0, -0.1, 1.0, 0.001)  # turned, it is from 0.1 to 9
    assert runs_backwards((sure, skewed)) is not None
