"""The experiment that is advised, and what is played through for it (docs/reference/trace.md, `separate_by`)."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import norm

from estimator.record import Record
from estimator.settings import ControllerSettings, Device, Gain, ObserverSettings, ProcessNoise, Spread
from estimator.trace import separation
from estimator.trace.evidence import Imitation
from estimator.trace.problem import Problem
from estimator.trace.scan import PARTS
from estimator.trace.searched import NOTHING
from estimator.trace.separation import EXPERIMENTS, Experiment, Turn, loop_record, separations, turn_for

RATE, HZ = 4000.0, 200.0
TARGET = (2.0 * np.pi * HZ) ** 2
DEVICE = Device(
    sample_rate=RATE,
    stiffness=(TARGET, TARGET, 0.0),
    damping=(8.0, 8.0, 0.0),
    amplitude=1e-4,
    sense_gain=(-890.0, 900.0),
    noise=(1e-4, 1e-4),
)
SETTINGS = ObserverSettings(effects={"drag": {"dqx": 1.0}}, memory=0.1, spread=Spread(stiffness=1e-3, damping=0.05))
CONTROLLER = ControllerSettings(latency=3, force_quantum=1e-3, force_limit=10.0, sense_quantum=1e-5)
BY_NAME = {experiment.name: experiment for experiment in EXPERIMENTS}


SPAN = 9 / RATE  # of the record in `advised`, and as long are its experiments


@pytest.fixture
def advised(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The advice for drive gain beside another, of likenesses and of what differs in twice the log-likelihood in an
    experiment as long as the record, and what was asked.
    """

    def run(
        shown: dict[str, Any],
        controller: Any = CONTROLLER,
        settings: ObserverSettings = SETTINGS,
        unsure: float = 0.0,
        *,
        carried: bool = True,
    ) -> Any:
        asked = SimpleNamespace(latency=set(), coefficients=[], watched=[], told=[], turns=set(), begun=set())

        def play(
            experiment: Any, device: Device, settings: ObserverSettings, *, latency: int, turn: Any, span: float
        ) -> Any:
            asked.latency.add(latency)
            asked.turns.add((turn, span))
            asked.settings = settings
            return SimpleNamespace(name=experiment.name, sense=np.zeros((9, 2)), step=np.full(9, 1 / RATE))

        def scan(problem: Problem, watched: Any) -> Any:
            asked.watched.append(watched)
            return SimpleNamespace(
                of=problem.record, columns={"drive_gain": slice(0, 2), "drive_saturation": slice(2, 4)}
            )

        def imitations(seen: Any, name: str, coefficients: Any, *, begin: int) -> dict[str, Any]:
            asked.begun.add(begin)
            asked.coefficients.append((name, None if coefficients is None else coefficients.tolist()))
            if (found := shown.get(seen.of.name)) is None:
                return {}
            alike, left = found
            # of what is looked at, which is the second half
            one = SimpleNamespace(likeness=alike, left=0.5 * left, form=np.diag([1.0, 2.0]))
            return dict.fromkeys(("drive_gain", "drive_saturation"), one)

        monkeypatch.setattr(separation, "loop_record", play)
        monkeypatch.setattr(separation, "scan", scan)
        monkeypatch.setattr(separation, "imitations", imitations)
        monkeypatch.setattr(separation, "covariance_of", lambda name, model, searched: unsure / 3.0 * np.eye(2))
        looks: Any = ({"drive_gain": {}}, {"drive_gain": {"late": 1.0}, "drive_saturation": {"limit": 2.0}})
        selection: Any = SimpleNamespace(
            effects={"drive_saturation": {"sx": 0.3, "sy": 0.4, "limit": 2.0}},
            rounds=[SimpleNamespace(look=SimpleNamespace(watched=watched)) for watched in looks],
            before=SimpleNamespace(settings=ObserverSettings(initial={"kxx": 7.0, "kyy": 8.0, "phi_x": 9.0})),
            after=left_with(kxx=7.5),
            searched={"drive_saturation": NOTHING},
            rivals={"drive_saturation": {"drive_gain": object()} if carried else {}},
        )
        record = Record(np.zeros((9, 2)), np.zeros((9, 2, 1)), np.full(9, 1 / RATE))
        pairs = [("drive_saturation", "drive_gain"), ("drive_gain", "drive_saturation")]
        problem = Problem(record, DEVICE, settings, controller)
        return separations(pairs, selection, problem, lambda *what: asked.told.append(what)), asked

    return run


def left_with(**constants: float) -> Any:
    """A model that ended with these constants of the device, SI."""
    names = ("x", "vx", "y", "vy", *constants)
    return SimpleNamespace(
        observer=SimpleNamespace(
            model=SimpleNamespace(names=names), states=4, state=np.array([0.0, 0.0, 0.0, 0.0, *constants.values()])
        )
    )


def needed() -> float:
    """Twice the log-likelihood, normal about d² with 2 d, that is worth odds of 20 to 1 in 95 of 100: by SciPy."""
    tie = 2.0 * np.log(20.0)
    return float(brentq(lambda square: norm.sf(tie, square, 2.0 * np.sqrt(square)) - 0.95, 8.0, 80.0))


VAIN = dict.fromkeys(BY_NAME, (0.99999, 1e-3))
WANDERS = replace(SETTINGS, process_noise=ProcessNoise(rate=0.5))


def test_the_simplest_experiment_is_made_where_it_needs_no_longer_than_the_record(advised: Any) -> None:
    """However much more another tells."""
    found, _ = advised(VAIN | {"dither": (0.7, 1.01 * needed()), "stiffness": (0.1, 1e4), "all": (0.1, 1e6)})
    assert [one.experiment for one in found] == [BY_NAME["dither"]] * 2
    assert found[0].expected == 0.7
    assert found[0].words == "dither the drive off the resonance"


def test_how_long_it_takes_is_by_what_the_two_differ_there(advised: Any) -> None:
    (first, _), _ = advised(VAIN | {"stiffness": (0.9, 0.25 * needed())})
    assert first.experiment == BY_NAME["stiffness"]
    assert first.takes == pytest.approx(4.0 * SPAN, rel=1e-3)


def test_what_is_not_sure_of_a_difference_makes_it_longer(advised: Any) -> None:
    """Half of what is seen: as long again.  Of an effect that is not carried, no covariance is known."""
    found, _ = advised(VAIN | {"stiffness": (0.9, needed())}, unsure=0.25 * needed())
    assert [one.takes for one in found] == pytest.approx([2.0 * SPAN, SPAN], rel=1e-3)


@pytest.mark.parametrize(("longer", "told"), [(1.9, "dither"), (2.1, "together")])
def test_several_at_once_are_made_where_one_takes_twice_as_long(advised: Any, longer: float, told: str) -> None:
    (first, _), _ = advised(VAIN | {"dither": (0.9, needed() / longer), "together": (0.9, needed())})
    assert first.experiment == BY_NAME[told]


@pytest.mark.parametrize(
    ("longer", "by", "told"),
    [(1.9, "rate", "dither"), (2.1, "rate", "rate"), (3.9, "all", "dither"), (4.1, "all", "all")],
)
def test_nobody_is_asked_to_turn_what_tells_nearly_as_soon_by_itself(
    advised: Any, longer: float, by: str, told: str
) -> None:
    (first, _), _ = advised(VAIN | {"dither": (0.9, needed() / longer), by: (0.9, needed())}, settings=WANDERS)
    assert first.experiment == BY_NAME[told]


def test_where_the_rate_is_a_constant_to_the_observer_nobody_turns(advised: Any) -> None:
    (first, _), asked = advised(VAIN | {"rate": (0.1, 1e6), "all": (0.1, 1e6)})
    assert first == (None, None, None, None)
    assert asked.told[-1] == ("experiments", 5, 5)


@pytest.mark.parametrize(("longer", "separates"), [(101.0, False), (99.0, True)])
def test_what_takes_a_hundred_times_the_record_is_not_advised(advised: Any, longer: float, separates: bool) -> None:
    (first, _), _ = advised(dict.fromkeys(BY_NAME, (0.9, needed() / longer)))
    assert (first.experiment is not None) is separates


def test_an_experiment_that_cannot_be_followed_tells_nothing(advised: Any) -> None:
    """Where its observer diverges, nothing can be said of the other: nothing here."""
    found, _ = advised({})
    assert found == [(None, None, None, None)] * 2
    found, _ = advised({"rate": (0.5, 100.0)}, settings=WANDERS)
    assert [one.experiment for one in found] == [BY_NAME["rate"]] * 2


@pytest.mark.parametrize(("unsure", "times"), [(1.5, 2.0), (2.7, 10.0), (3.1, 100.0), (6.0, 100.0)])
def test_what_may_be_there_by_the_coefficients_own_scatter_counts_for_nothing(unsure: float, times: float) -> None:
    """Of 3, so much; where it may be all, it takes as long as any."""
    shown = Imitation(9.0, np.array([[1.0, 0.5], [0.5, 2.0]]), 3.0)
    covariance = unsure / 4.0 * np.array([[1.0, 0.5], [0.5, 1.25]])
    assert np.trace(shown.form @ covariance) == pytest.approx(unsure)
    length = 3.0 / needed()
    found = separation._takes(shown, covariance, length, 100.0)
    assert found == pytest.approx(times, rel=1e-3)


@pytest.mark.parametrize(("expected", "told"), [(0.9999, ("dither", "stiffness")), (0.99, ("dither", "dither"))])
def test_what_is_listed_for_its_signature_needs_an_experiment_with_another(
    advised: Any, expected: float, told: tuple[str, str]
) -> None:
    """Beyond the likeness by which it is listed it would be listed again; what was carried is judged by its fit."""
    shown = VAIN | {"dither": (expected, 10.0 * needed()), "stiffness": (0.9, 0.5 * needed())}
    for carried, name in zip((True, False), told, strict=True):
        (first, _), _ = advised(shown, carried=carried)
        assert first.experiment == BY_NAME[name]


def test_two_that_are_the_same_take_for_ever(advised: Any) -> None:
    (first, _), _ = advised(dict.fromkeys(BY_NAME, (1.0, -1e-12)))
    assert first == (None, None, None, None)


def test_whoever_turns_is_told_how(advised: Any) -> None:
    (first, _), asked = advised({"rate": (0.5, 100.0)}, settings=WANDERS)
    ((turn, span),) = asked.turns
    assert span == pytest.approx(SPAN)
    assert turn == turn_for(2.0 * np.pi * HZ, 0.5, SPAN)
    assert first.words == f"turn the gyro at a varying rate: {turn.text}"
    assert Turn(1.0, 8.0).text == "to and fro in 8 s, at most at 1 rad/s (57.3 °/s)"


@pytest.mark.parametrize("wander", [0.01, 0.5])
def test_a_turn_is_as_far_as_the_rate_wanders_in_half_a_period(wander: float) -> None:
    """Three periods in the record."""
    turn = turn_for(2.0 * np.pi * HZ, wander, 24.0)
    assert turn.period == pytest.approx(8.0)
    assert 2.0 * turn.rate == pytest.approx(wander * np.sqrt(0.5 * turn.period))


def test_a_turn_is_no_faster_than_a_table_and_the_holds_allow() -> None:
    omega0 = 2.0 * np.pi * HZ
    turn = turn_for(omega0, 1e6, 0.01)
    assert turn.rate == pytest.approx(1e-3 * omega0)
    assert turn.period == pytest.approx(150.0 / HZ)
    assert turn_for(omega0, 0.0, 24.0).rate == 0.0


@pytest.mark.beyond(1)
@pytest.mark.moderate
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_where_the_model_is_no_oscillator_any_more_what_is_declared_is_played(
    monkeypatch: pytest.MonkeyPatch, sign: float
) -> None:
    """Constants as a large lag in the sense chain has left them: a spring that pushes, damping as large as ω0."""
    left = {"rate": -500.0, "kxx": TARGET, "kyy": sign * TARGET, "kxy": -1.2 * TARGET, "dxx": -250.0, "dyy": 300.0}
    gains = {"drive_gain": {"gx": 0.05, "gy": 0.0}}
    selection: Any = SimpleNamespace(
        effects=gains,
        rounds=[SimpleNamespace(look=SimpleNamespace(watched={"drive_gain": {}, "sense_gain": {}}))],
        before=SimpleNamespace(settings=ObserverSettings(initial=left)),
        after=left_with(**left),
        searched={"drive_gain": NOTHING},
        rivals={"drive_gain": {"sense_gain": object()}},
    )
    monkeypatch.setattr(separation, "covariance_of", lambda name, model, searched: np.zeros((2, 2)))
    record = Record(np.zeros((9, 2)), np.zeros((9, 2, 1)), np.full(9, 1 / RATE))
    problem = Problem(record, DEVICE, SETTINGS, CONTROLLER)
    pairs = [("drive_gain", "sense_gain")]
    with np.errstate(all="ignore"):
        (found,) = separations(pairs, selection, problem, lambda *what: None)
    selection.before.settings, selection.after = ObserverSettings(initial={}), left_with()
    assert [found] == separations(pairs, selection, problem, lambda *what: None)
    assert found.experiment is not None


def test_experiments_are_played_with_the_constants_that_the_effects_leave_and_the_benchs_latency(advised: Any) -> None:
    """Without the effects, what they do may be in the constants; those beside them are as they were."""
    _, asked = advised(VAIN, settings=WANDERS)
    assert asked.latency == {3}
    assert (asked.settings.gain, asked.settings.effects) == (Gain.EKF, {})
    assert asked.settings.initial == {"kxx": 7.5, "kyy": 8.0, "phi_x": 9.0}
    assert all(watched == {"drive_saturation": {"limit": 2.0}, "drive_gain": {}} for watched in asked.watched)
    assert asked.coefficients[:2] == [("drive_saturation", [0.3, 0.4]), ("drive_gain", None)]
    assert asked.told[-1] == ("experiments", 7, 7)
    assert asked.begun == {PARTS // 2}  # the second half, which is settled
    _, asked = advised(VAIN, None)
    assert asked.latency == {1}


def test_a_single_axis_has_no_experiment_and_no_pair_no_advice() -> None:
    single = Device(
        sample_rate=RATE, stiffness=(1.6e6,), damping=(1.0,), amplitude=1e-4, sense_gain=(-890.0,), noise=(1e-4,)
    )
    record = Record(np.zeros((9, 1)), np.zeros((9, 1, 1)), np.full(9, 1 / RATE))
    selection: Any = None
    assert separations([("a", "b")] * 2, selection, Problem(record, single, SETTINGS), print) == [(None,) * 4] * 2
    assert separations([], selection, Problem(record, DEVICE, SETTINGS), print) == []


@pytest.mark.parametrize(("name", "span", "samples"), [
    ("rate", 3.0, 12_000), ("rate", 30.0, 40_000), ("rate", 1.0, 8_000), ("dither", 3.0, 8_000),
])  # fmt: skip
def test_a_turn_is_played_for_as_long_as_the_record_within_reason(
    monkeypatch: pytest.MonkeyPatch, name: str, span: float, samples: int
) -> None:
    monkeypatch.setattr(separation, "experiment_block", lambda *given: None)
    record = loop_record(BY_NAME[name], DEVICE, SETTINGS, latency=1, span=span)
    assert len(record) == pytest.approx(samples, abs=1)


# -- what is played through ------------------------------------------------------------------------------------------


CYCLE = round(RATE / HZ)


def played(name: str, noise: float = 0.0) -> Any:
    """Record, displacements (n, 2) in amplitudes and drive (n, 2) in k A."""
    record = loop_record(BY_NAME[name], DEVICE, SETTINGS, latency=1, noise=noise)
    volts = np.array(DEVICE.sense_gain) * DEVICE.amplitude
    return record, record.sense / volts, record.drive[:, :, 0] / (TARGET * DEVICE.amplitude)


def sizes(motion: Any) -> Any:
    """The longest half axis of each cycle."""
    cycles = motion[: len(motion) // CYCLE * CYCLE].reshape(-1, CYCLE, 2)
    return np.sqrt(2.0 / CYCLE * np.linalg.norm(cycles, ord=2, axis=(1, 2)) ** 2)


def orientation(motion: Any) -> Any:
    """Of each cycle's longest axis, rad, followed over the turns."""
    cycles = motion[: len(motion) // CYCLE * CYCLE].reshape(-1, CYCLE, 2)
    x2, y2, xy = (np.sum(cycles[:, :, a] * cycles[:, :, b], axis=1) for a, b in ((0, 0), (1, 1), (0, 1)))
    return np.unwrap(np.arctan2(2.0 * xy, x2 - y2)) / 2.0


@pytest.mark.moderate
def test_an_experiment_is_400_cycles_at_a_held_amplitude_while_the_pattern_turns() -> None:
    record, motion, drive = played("virtual_rotation")
    assert len(record) == 400 * CYCLE
    np.testing.assert_array_equal(record.step, 1 / RATE)
    assert record.drive.shape == (400 * CYCLE, 2, 1)
    assert sizes(motion)[20:] == pytest.approx(1.0, abs=0.03)
    turned = orientation(motion)
    assert abs(turned[-1] - turned[100]) == pytest.approx(2e-3 * 2.0 * np.pi * 299, rel=0.1)
    assert np.max(np.abs(drive)) < 0.2  # nothing but damping is to be overcome


@pytest.mark.moderate
def test_the_amplitude_is_modulated_by_30_percent() -> None:
    held = sizes(played("amplitude")[1])[60:]
    assert np.max(held) == pytest.approx(1.3, abs=0.06)
    assert np.min(held) == pytest.approx(0.7, abs=0.06)


@pytest.mark.moderate
def test_a_dither_is_a_drive_off_the_resonance() -> None:
    usual, dithered = (np.abs(np.fft.rfft(played(name)[2][:, 0])) for name in ("virtual_rotation", "dither"))
    bins = np.arange(len(usual)) / len(usual)
    off = np.abs(bins - HZ / (RATE / 2.0)) > 0.02
    assert np.max(np.abs(played("dither")[2])) > BY_NAME["dither"].dither  # in k A
    assert np.sum(dithered[off] ** 2) > 10.0 * np.sum(usual[off] ** 2)


@pytest.mark.moderate
def test_the_stiffness_steps_by_two_percent_to_either_side() -> None:
    """±2 % of the square of the frequency, for 60 cycles each; seen where the motion crosses zero."""
    _, motion, _ = played("stiffness")
    along = motion[:, 0]
    rising = np.flatnonzero((along[:-1] < 0.0) & (along[1:] >= 0.0))
    crossings = rising - along[rising] / (along[rising + 1] - along[rising])
    fast = (crossings > 5 * CYCLE) & (crossings < 55 * CYCLE)
    slow = (crossings > 65 * CYCLE) & (crossings < 110 * CYCLE)
    usual, stepped = (np.mean(np.diff(crossings[part])) for part in (slow, fast))
    assert (usual / stepped) ** 2 == pytest.approx(1.02 / 0.98, rel=2e-3)


@pytest.mark.moderate
def test_a_rate_that_swings_turns_the_pattern_against_it() -> None:
    """Beside the same without it: by a share of −∫Ω dt = 0.15 (cos(ω0 t / 150) − 1), as the case turns under it."""
    usual, turned = (orientation(played(name)[1]) for name in ("virtual_rotation", "rate"))
    t = np.arange(len(usual)) * 2.0 * np.pi
    waves = np.stack([np.ones_like(t), t, np.cos(t / 150.0), np.sin(t / 150.0)], axis=1)
    _, _, against, beside = np.linalg.lstsq(waves, turned - usual, rcond=None)[0]
    assert against > 0.05
    assert np.hypot(against, beside) < 0.15


@pytest.mark.moderate
def test_noise_is_that_of_the_device_times_what_is_asked() -> None:
    """Told far above the resonance, where nothing moves."""
    usual, loud = (played("virtual_rotation", noise)[0].sense for noise in (1.0, 3.0))
    window = np.hanning(len(usual))[:, None]
    one, three = (
        np.sqrt(np.mean(np.abs(np.fft.rfft(window * sense, axis=0)[-2000:]) ** 2, axis=0) / np.sum(window**2))
        for sense in (usual, loud)
    )
    assert one == pytest.approx(np.array(DEVICE.noise), rel=0.1)
    assert three == pytest.approx(3.0 * one, rel=0.1)
    np.testing.assert_array_equal(usual, played("virtual_rotation", 1.0)[0].sense)  # the same each time


def test_an_experiment_does_nothing_but_what_it_says() -> None:
    assert Experiment("still", "do nothing") == Experiment("still", "do nothing", 0.0, 0.0, 0.0, 0.0, False)


@pytest.mark.parametrize(
    ("constants", "holds"),
    [
        ({"kxx": 4.0, "kyy": 9.0, "kxy": 5.9}, True),
        ({"kxx": 4.0, "kyy": 9.0, "kxy": -5.9}, True),
        ({"kxx": 4.0, "kyy": 9.0, "kxy": 6.0}, False),  # along one direction nothing holds it
        ({"kxx": 4.0, "kyy": 9.0, "kxy": -6.1}, False),
        ({"kxx": 0.5, "kyy": 0.5, "kxy": 0.6}, False),
        ({"kxx": 0.5, "kyy": 0.5, "kxy": 0.4}, True),
        ({"kxx": -4.0, "kyy": -9.0, "kxy": 0.0}, False),
        ({"kxx": 0.0, "kyy": 9.0, "kxy": 0.0}, False),
        ({"kxy": 0.9 * TARGET, "rate": 5.0}, True),  # beside the declared springs
        ({"kxy": 1.1 * TARGET}, False),
    ],
)
def test_springs_hold_a_mass_in_every_direction_or_it_does_not_oscillate(
    constants: dict[str, float], holds: bool
) -> None:
    assert separation._oscillates(constants, DEVICE) is holds


def test_an_experiment_is_played_by_the_loop_that_it_asks_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """In the units of the bench: forces of k A, the converter's code of the quieter channel's noise, rates of ω0."""
    omega0 = 2.0 * np.pi * HZ
    laws: list[ControllerSettings] = []
    device = replace(DEVICE, noise=(3e-4, 1e-4), drive_gain=2.0)
    made = separation.Observer

    def observer(of: Device, settings: ObserverSettings, law: ControllerSettings) -> Any:
        laws.append(law)
        assert (settings.gain, settings.effects, settings.memory) == (Gain.EKF, {}, 0.1)
        return made(of, settings, law)

    seen: list[Any] = []

    def block(observer: Any, truth: Any, plan: Any, sensed: Any, drive: Any) -> None:
        seen.append((truth.copy(), plan))
        sensed[:] = 0.5, 2.0
        drive[:] = 0.25, -1.0

    monkeypatch.setattr(separation, "Observer", observer)
    monkeypatch.setattr(separation, "experiment_block", block)
    experiment = Experiment("any", "do it", virtual=2e-3, modulation=0.4, dither=3e-3, stiffness=0.02, turning=True)
    turn = Turn(5e-3 * omega0, 2.0 * np.pi * 130.0 / omega0)
    record = loop_record(experiment, device, SETTINGS, latency=4, turn=turn)
    force = 1e-4 * TARGET  # m/s², whatever unit the drive has
    (law,) = laws
    assert law.latency == 4
    assert (law.force_quantum, law.force_limit) == (pytest.approx(1e-6 * force), pytest.approx(10.0 * force))
    assert law.sense_quantum == pytest.approx(1e-5)
    assert (law.energy_gain, law.quadrature_gain) == (0.1, 0.1)
    assert law.virtual_rotation == pytest.approx(2e-3 * omega0)
    assert law.dither == pytest.approx(3e-3 * force)
    assert (law.modulation, law.modulation_rate) == (0.4, pytest.approx(omega0 / 200.0))
    ((truth, plan),) = seen
    assert truth[:4].tolist() == [1.0, 0.0, 0.0, 0.0]
    cycle = RATE / HZ
    n = np.arange(int(400 * cycle))
    phase = 2.0 * np.pi * n / cycle
    np.testing.assert_allclose(plan.rates, 5e-3 * np.sin(phase / 130.0), atol=1e-9)
    np.testing.assert_allclose(plan.stiffness, 1.0 + 0.02 * np.sign(np.sin(phase / 120.0)), atol=1e-9)
    np.testing.assert_allclose(np.std(plan.noise, axis=0) * 1e-4 * np.array([890.0, 900.0]), device.noise, rtol=0.05)
    np.testing.assert_allclose(record.sense, [[-0.5 * 890.0 * 1e-4, 2.0 * 900.0 * 1e-4]] * len(n))
    np.testing.assert_allclose(record.drive[:, :, 0], [[0.25 * force / 2.0, -force / 2.0]] * len(n))
    np.testing.assert_array_equal(record.step, 1 / RATE)
