"""Three arithmetics, one model: compiled kernels, plain NumPy and filterpy give the same estimates on the same
record.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from estimator.backend import Backend, make_observer
from estimator.errors import ModelError
from estimator.hold import Hold, drive_polynomials
from estimator.observer import Observer
from estimator.settings import Device, Gain, ObserverSettings, ProcessNoise, Spread, Variant
from tests.estimator.agreement import disagreement
from tests.estimator.gyro_loop import Array, Record, Truth, close_loop, observer_of, swing

ORACLES: tuple[Backend, ...] = ("numpy", "filterpy")
EQUAL = 1e-7
TRUTH = Truth(offset=(0.0, 0.0), force_noise=1e-5)
NOISE = ProcessNoise(force=1e-5, rate=0.1, offset=1e-5, stiffness=1e-4, damping=1e-2, drive_gain=1e-3)


@pytest.fixture(scope="module")
def record() -> Record:
    """1,000 samples of a closed loop that starts with wrong stiffness and damping, with lost samples in it."""
    observer = observer_of(TRUTH, ObserverSettings(), dither=0.3)
    made = close_loop(observer, TRUTH, 1000, 1.5, acquire=200)
    made.sense[300:305] = np.nan
    made.sense[400, 0] = np.nan
    made.sense[410:412, 1] = np.nan
    return made


def single_axis(device: Device) -> Device:
    """The x axis of a device as a device of its own, driven in newtons."""
    return replace(
        device, stiffness=device.stiffness[:1], damping=device.damping[:1], sense_gain=device.sense_gain[:1],
        noise=device.noise[:1], drive_gain=2.0,
    )  # fmt: skip


def worst(one: Observer, other: Observer, sense: Array, drive: Array, **how: object) -> tuple[float, str]:
    found = disagreement(one.run(sense, drive, **how), other.run(sense, drive, **how))
    return max((value, name) for name, value in found.items())


@pytest.mark.beyond(7)
@pytest.mark.slow
@pytest.mark.parametrize(
    ("variant", "gain", "hold"),
    [
        *((variant, gain, "zoh") for variant in Variant for gain in (Gain.EKF, Gain.FADING)),
        (Variant.FULL, Gain.FADING, "bandlimited"),
    ],
)
@pytest.mark.parametrize("backend", ORACLES)
def test_equal_on_a_closed_loop_record(
    record: Record, backend: Backend, variant: Variant, gain: Gain, hold: Hold
) -> None:
    off = 1.0 if variant is Variant.SENSE else 1.03
    device = TRUTH.device(stiffness=off, damping=off)
    settings = ObserverSettings(variant=variant, gain=gain, process_noise=NOISE)
    pair = [make_observer(name, device, settings, TRUTH.controller()) for name in ("c", backend)]
    apart, where = worst(*pair, record.sense, drive_polynomials(record.drive, hold))
    assert apart < EQUAL, where


@pytest.mark.slow
@pytest.mark.parametrize(("gain", "hold"), [(Gain.EKF, "bandlimited"), (Gain.FADING, "zoh")])
@pytest.mark.parametrize("backend", ORACLES)
def test_equal_on_one_axis(record: Record, backend: Backend, gain: Gain, hold: Hold) -> None:
    settings = ObserverSettings(gain=gain, process_noise=NOISE)
    pair = [make_observer(name, single_axis(TRUTH.device()), settings) for name in ("c", backend)]
    apart, where = worst(*pair, record.sense[:, :1], drive_polynomials(record.drive[:, :1], hold))
    assert apart < EQUAL, where


@pytest.mark.moderate
@pytest.mark.parametrize("backend", ORACLES)
def test_equal_while_the_memory_shortens_and_the_prior_is_recalled(backend: Backend) -> None:
    """A jump of the rate, a stiffness further off than its spread: forgetting in haste, up to the initial spread."""
    jump = np.where(np.arange(601) < 300, 1.5, 31.5)
    made = close_loop(observer_of(TRUTH, ObserverSettings(memory=1.0)), TRUTH, 600, jump, acquire=200)
    settings = ObserverSettings(memory=1.0, spread=Spread(stiffness=0.01))
    device = TRUTH.device(stiffness=1.03)
    one, other = (make_observer(name, device, settings, TRUTH.controller()) for name in ("c", backend))
    found = one.run(made.sense, made.drive)
    agreement = disagreement(found, other.run(made.sense, made.drive))
    assert max(agreement.values()) < EQUAL, agreement
    hurried = found.deviation[:, found.names.index("rate")]
    assert np.max(hurried[300:400]) > 1.5 * hurried[299]


@pytest.mark.beyond(1)
@pytest.mark.slow
@pytest.mark.parametrize("variant", list(Variant))
def test_a_stationary_gain_is_looked_up_alike(record: Record, variant: Variant) -> None:
    settings = ObserverSettings(
        variant=variant, gain=Gain.STATIONARY, memory=0.05, acquisition=0.02, process_noise=NOISE
    )
    pair = [make_observer(name, TRUTH.device(), settings, TRUTH.controller()) for name in ("c", "numpy")]
    apart, where = worst(*pair, record.sense[:450], record.drive[:450])
    assert apart < EQUAL, where


@pytest.mark.moderate
def test_equal_with_intervals_of_their_own_length_and_in_blocks() -> None:
    """A record with gaps, estimated in three blocks: nothing is lost between them."""
    device, settings = TRUTH.device(stiffness=1.03), ObserverSettings(process_noise=NOISE)
    rng = np.random.default_rng(3)
    step = rng.choice([1, 1, 1, 2, 5], 240) / TRUTH.sample_rate
    sense, drive = free_record(TRUTH, step, 2.0, rng)
    whole = make_observer("c", device, settings).run(sense, drive, step=step, every=3)
    oracle = make_observer("numpy", device, settings)
    parts = [oracle.run(*(x[i : i + 80] for x in (sense, drive)), step=step[i : i + 80]) for i in (0, 80, 160)]
    for name in ("angle", "angle_pattern", "angle_plain", "angle_rate_integral", "energy_ratio"):
        np.testing.assert_allclose(np.concatenate([getattr(p, name) for p in parts]), getattr(whole, name), atol=EQUAL)
    state = np.concatenate([p.state for p in parts])[whole.index] / oracle.factors
    np.testing.assert_allclose(state, whole.state / oracle.factors, atol=EQUAL)


def free_record(truth: Truth, step: Array, rate: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Sense (n, 2) [V] and random held drive (n, 2) [m/s²] of the plant over intervals `step` (n,) [s]."""
    n = len(step)
    drive = rng.standard_normal((n, 2)) * 0.05 * truth.amplitude * truth.omega0**2
    s = np.array(truth.start) * truth.amplitude * [1.0, truth.omega0, 1.0, truth.omega0]
    sense = rng.standard_normal((n, 2)) * truth.noise + truth.offset
    for m in range(n):
        swing(s, truth.parameters, *drive[m], rate, rate, step[m])
        sense[m] += truth.sense_gain * s[[0, 2]]
    return sense, drive


@st.composite
def cases(draw: st.DrawFn) -> tuple[Truth, ObserverSettings, float, float]:
    """A device, settings, its true rate [rad/s] and the factor its declared stiffness is off by.

    The declared device is wrong only where the settings admit it: an observer that is told falsehoods as certainties
    meets innovations of a thousand deviations, and then rounding is amplified as much.
    """
    a = st.floats
    variant = draw(st.sampled_from(list(Variant)))
    omega0 = draw(st.sampled_from([2 * np.pi * 70.0, 2 * np.pi * 200.0, 2.2e4]))
    amplitude = draw(st.sampled_from([1e-6, 1e-4]))
    gain = draw(st.sampled_from([-890.0, 8.9e4]))
    volts = abs(gain) * amplitude
    offset = 0.0 if variant is Variant.GYRO else draw(st.sampled_from([0.0, 0.1]))
    stiffness = 0.0 if variant is Variant.SENSE else draw(st.sampled_from([0.0, 0.05]))
    angle, phase = draw(a(0.0, 6.3)), draw(a(0.0, 6.3))
    truth = Truth(
        sample_rate=omega0 / (2 * np.pi) * draw(a(6.0, 60.0)),
        omega0=omega0,
        amplitude=amplitude,
        stiffness=(draw(a(0.8, 1.2)), draw(a(0.8, 1.2)), draw(a(-0.1, 0.1))),
        damping=(draw(a(1e-4, 1e-2)), draw(a(1e-4, 1e-2)), draw(a(-1e-4, 1e-4))),
        sense_gain=gain,
        offset=(draw(a(-2.0, 2.0)) * offset * volts, draw(a(-2.0, 2.0)) * offset * volts),
        noise=volts * draw(st.sampled_from([1e-3, 1e-2, 5e-2])),
        start=(
            np.cos(angle) * np.cos(phase), -np.cos(angle) * np.sin(phase),
            np.sin(angle) * np.cos(phase), -np.sin(angle) * np.sin(phase),
        ),
    )  # fmt: skip
    settings = ObserverSettings(
        variant=variant,
        gain=draw(st.sampled_from([Gain.EKF, Gain.FADING])),
        memory=draw(a(20.0, 2000.0)) / truth.sample_rate,
        spread=Spread(
            offset=offset * volts, rate=0.01 * omega0, stiffness=stiffness, drive_gain=draw(st.sampled_from([0.0, 0.2]))
        ),
        process_noise=ProcessNoise(rate=draw(a(0.0, 1e-3)) * omega0, damping=draw(a(0.0, 0.1))),
    )
    off = 1.0 if stiffness == 0.0 else draw(a(0.97, 1.03))
    return truth, settings, draw(a(-0.01, 0.01)) * omega0, off


@pytest.mark.beyond(1)
@pytest.mark.slow
@pytest.mark.parametrize("axes", [1, 2])
@hypothesis_settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(case=cases(), seed=st.integers(0, 2**32 - 1), hold=st.sampled_from(["zoh", "foh"]))
def test_equal_for_any_device(
    axes: int, case: tuple[Truth, ObserverSettings, float, float], seed: int, hold: Hold
) -> None:
    truth, settings, rate, off = case
    rng = np.random.default_rng(seed)
    step = np.full(60, 1.0 / truth.sample_rate)
    sense, drive = free_record(truth, step, rate, rng)
    sense[rng.random(sense.shape) < 0.05] = np.nan
    device = truth.device(stiffness=off)
    if axes == 1:
        device, sense, drive = single_axis(device), sense[:, :1], drive[:, :1]
    drive = drive_polynomials(drive, hold)
    reference = make_observer("c", device, settings).run(sense, drive)
    for backend in ORACLES:
        found = disagreement(make_observer(backend, device, settings).run(sense, drive), reference)
        apart, where = max((value, name) for name, value in found.items())
        assert apart < EQUAL, (backend, where)


def test_agreement_sees_a_difference_in_every_quantity() -> None:
    """The yardstick itself: each field of the estimates, changed by a millionth, shows under its own name."""
    observer = Observer(TRUTH.device(), ObserverSettings(gain=Gain.EKF))
    step = np.full(50, 1.0 / TRUTH.sample_rate)
    found = observer.run(*free_record(TRUTH, step, 1.0, np.random.default_rng(0)))
    assert max(disagreement(found, found).values()) == 0.0
    for column, name in enumerate(found.names):
        state = found.state.copy()
        state[:, column] *= 1.0 + 1e-6
        assert disagreement(replace(found, state=state), found)[name] > 1e-8
    for name in ("deviation", "innovation", "innovation_deviation", "angle", "angle_pattern", "angle_plain",
                 "angle_rate_integral", "energy_ratio", "quadrature_ratio"):  # fmt: skip
        changed = replace(found, **{name: getattr(found, name) * (1.0 + 1e-6)})
        seen = {key for key, value in disagreement(changed, found).items() if value > 0.0}
        assert name in seen


@pytest.mark.parametrize("backend", ORACLES)
def test_oracles_only_replay(backend: Backend) -> None:
    observer = make_observer(backend, TRUTH.device(), ObserverSettings(), TRUTH.controller())
    with pytest.raises(ModelError, match=f"backend '{backend}' only replays records; close the loop with backend 'c'"):
        observer.tick(0.0, 0.0, 0.0, 0.0)


def test_filterpy_has_no_stationary_gain() -> None:
    with pytest.raises(ModelError, match="no stationary gain; use backend 'c' or 'numpy'"):
        make_observer("filterpy", TRUTH.device(), ObserverSettings(gain=Gain.STATIONARY))


def test_unknown_backend_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ModelError, match="no backend 'fortran'; known: c, numpy, filterpy"):
        make_observer("fortran", TRUTH.device(), ObserverSettings())  # type: ignore[arg-type]
