"""What is watched on a record, with which parameters: as estimator/thresholds.py says, written out."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from estimator.custom import Coefficient, Declaration, Parameter
from estimator.effects.catalogue import EFFECTS
from estimator.effects.labels import kind, searched_by
from estimator.effects.search import Search
from estimator.record import Record
from estimator.scaling import Array
from estimator.settings import Device, ObserverSettings
from estimator.trace import start_values
from estimator.trace.candidates import candidates as tried
from estimator.trace.problem import Effects, Problem
from tests.estimator.test_own_effects import with_own

RATE, N = 4000.0, 12_000
OMEGA0 = 2.0 * np.pi * 200.0
GYRO = Device(
    sample_rate=RATE, stiffness=(1.02 * OMEGA0**2, 0.98 * OMEGA0**2, 0.0), damping=(1.0, 1.2, 0.0), amplitude=2e-4,
    sense_gain=(-890.0, 445.0), noise=(1e-4, 1e-4), drive_gain=3.0, target_stiffness=OMEGA0**2,
)  # fmt: skip
SINGLE = Device(
    sample_rate=RATE, stiffness=(OMEGA0**2,), damping=(1.0,), amplitude=2e-4, sense_gain=(-890.0,), noise=(1e-4,)
)
RNG = np.random.default_rng(5)
WHITE = RNG.standard_normal((N, 2))
DRIVE = np.clip(RNG.standard_normal((N, 2, 1)), -2.0, 2.0)
SENSE = np.stack([np.linspace(-0.1, 0.08, N), np.linspace(0.09, -0.06, N)], axis=1)


def record(*, driven: bool = True, axes: int = 2, **channels: Any) -> Record:
    drive = DRIVE[:, :axes].copy() if driven else np.zeros((N, axes, 1))
    return Record(SENSE[:, :axes], drive, np.full(N, 1.0 / RATE), channels)


def watch_list(seen: Record, device: Device, innovation: Array, deviation: Array) -> Effects:
    """What is tried beside an empty model that leaves these innovations."""
    left: Any = SimpleNamespace(innovation=innovation, deviation=deviation)
    return tried(Problem(seen, device, ObserverSettings()), {}, left)


def watched(seen: Record, device: Device = GYRO, innovation: Array = WHITE, deviation: float = 1.0) -> Effects:
    axes = device.axes
    return watch_list(seen, device, innovation[:, :axes], np.full((N, axes), deviation))


@pytest.mark.moderate
def test_every_effect_that_needs_no_setting_is_watched_where_it_can_show() -> None:
    warm = set(watched(record(temperature=np.linspace(20.0, 30.0, N))))
    cold, free = set(watched(record())), set(watched(record(driven=False)))
    single = set(watched(record(axes=1), SINGLE))
    of_temperature = {effect.name for effect in EFFECTS if effect.name.startswith("temperature_")}
    assert of_temperature
    assert warm - cold == of_temperature
    assert {"drive_gain", "cubic_stiffness", "sense_gain", "drive_delay", "sense_delay"} <= cold
    gone = {kind(name) for name in cold} - {kind(name) for name in free}
    assert gone >= {"drive_delay", "sense_delay", "parasitic_mode", "drive_saturation", "drive_dead_band"}
    assert {"drive_gain", "cubic_stiffness", "sense_gain"} <= free
    assert {"cubic_stiffness", "drive_gain"} <= single
    assert not single & {"sense_gain", "nonreciprocal_stiffness", "sense_cross_coupling"}


@pytest.mark.moderate
@pytest.mark.parametrize(("scale", "low"), [(1.0, 3.0), (1e-4, 3.0), (1.0, 1.0)])
def test_lines_are_the_three_strongest_at_least_a_lobe_apart(scale: float, low: float) -> None:
    """3 s of record: a line of 1 Hz is a drift.  Beside a deviation, it does not matter in which unit."""
    t = np.arange(N) / RATE
    lines = ((low, 9.0), (150.0, 0.5), (333.0, 0.8), (777.0, 0.6), (900.0, 0.7), (1010.0, 0.4), (1500.0, 0.3))
    tones = sum(size * np.sin(2.0 * np.pi * hertz * t) for hertz, size in lines)
    innovation = scale * (WHITE + tones[:, None] * np.array([1.0, 0.3]))
    found = watched(record(), innovation=innovation, deviation=scale)
    seen = [found[f"interference:{label}"]["omega"] / (2.0 * np.pi) for label in range(1, 4)]
    expected = [333.0, 900.0, 777.0]
    assert seen == pytest.approx([low, *expected[:2]] if low > 2.0 else expected, abs=0.2)
    assert "interference:4" not in found
    for label in range(1, 4):
        assert found[f"base_vibration:{label}"] == found[f"interference:{label}"]


def test_white_noise_has_no_line() -> None:
    assert not any(kind(name) == "interference" for name in watched(record()))


# -- modes ------------------------------------------------------------------------------------------------------------


@pytest.mark.moderate
def test_lost_samples_say_nothing_of_a_mode_and_hide_none() -> None:
    """A residual that is the drive's own echo at 1.8 of the resonance, with a tenth of it lost."""
    t = np.arange(2000) / RATE
    echo = np.stack([np.convolve(DRIVE[:, a, 0], np.exp(-20 * t) * np.sin(1.8 * OMEGA0 * t))[:N] for a in (0, 1)], 1)
    innovation = echo + 0.3 * WHITE
    innovation[np.random.default_rng(1).random(N) < 0.1] = np.nan
    innovation[: N // 2] *= 1000.0  # as wide as predicted there, and no more than that
    deviation = np.where(np.arange(N) < N // 2, 1000.0, 1.0)[:, None] * np.ones((1, 2))
    seen = record()
    seen.drive[:1000] = 0.0  # off for a while is not off
    found = watch_list(seen, GYRO, innovation, deviation)
    assert {"drive_delay", "sense_delay"} <= set(found)
    assert any(
        abs(given["omega"] / (1.8 * OMEGA0) - 1.0) < 0.01
        for name, given in found.items() if kind(name) == "parasitic_mode"
    )  # fmt: skip


@pytest.mark.moderate
def test_a_mode_is_the_response_s_and_not_the_drive_s_peak() -> None:
    """A drive that is loudest at 372 Hz, and what it leaves of a mode at 360 Hz."""
    random = np.random.default_rng(7).standard_normal((N, 2))
    t = np.arange(4000) / RATE
    ringing = [np.exp(-w * z * t) * np.sin(w * t) for w, z in ((2 * np.pi * 372.0, 1e-2), (1.8 * OMEGA0, 1e-2))]
    drive = 0.1 * random + np.stack([np.convolve(random[:, a], ringing[0])[:N] for a in (0, 1)], axis=1)
    left = np.stack([np.convolve(drive[:, a], ringing[1])[:N] for a in (0, 1)], axis=1)
    left += 0.05 * np.std(left) * WHITE
    seen = replace(record(), drive=drive[:, :, None])
    found = watch_list(seen, GYRO, left, np.ones_like(left))
    modes = [given for name, given in found.items() if kind(name) == "parasitic_mode" and name.endswith("1")]
    assert min(abs(given["omega"] / (1.8 * OMEGA0) - 1.0) for given in modes) < 2e-3


@pytest.mark.parametrize(
    ("omega", "zeta", "seen"),
    [(1.0, 0.1, True), (1.0, 5e-5, False), (1.0, 0.69, True), (1.0, 0.72, False), (1.31, 0.01, False)],
)
def test_a_mode_is_between_the_bins_has_a_peak_and_is_not_too_narrow(omega: float, zeta: float, *, seen: bool) -> None:
    at = np.linspace(0.7, 1.3, 301) * 1000.0
    response = 2.0 / ((1000.0 * omega) ** 2 - at**2 + 2j * zeta * 1000.0 * omega * at)
    found = start_values.resonance(at, [response, -0.3 * response])
    assert (found is not None) is seen
    if found is not None:
        assert found == pytest.approx((1000.0 * omega, zeta), rel=1e-6)


# -- effects of one's own ---------------------------------------------------------------------------------------------


def own(name: str, tried: tuple[float, ...], *, default: float | None = 1e-5, signed: bool = False) -> Any:
    """A law with a length for a parameter, in metres; signed: with a signal of its own."""
    declared = Declaration(
        name,
        force=("-q * x * tanh(x / s0)" + (" * sign(vx)" if signed else ""), ""),
        coefficients={"q": Coefficient("1/s²")},
        parameters={"s0": Parameter("m", default, tried)},
    )
    return with_own(declared).own[0]


def own_watched(*effects: Any) -> dict[str, Any]:
    return watch_list(record(), replace(GYRO, own=effects, amplitude=1e-4), WHITE, np.ones_like(WHITE))


@pytest.mark.moderate
def test_values_of_one_s_own_are_tried_in_si_and_without_any_the_default() -> None:
    found = own_watched(own("mine", (1e-6, 1e-4)), own("plain", (), default=3e-5))
    mine = {name: given["s0"] for name, given in found.items() if kind(name) in ("mine", "plain")}
    assert mine == {
        "mine:1": pytest.approx(1e-6), "mine:2": pytest.approx(1e-4), "plain:1": pytest.approx(3e-5)
    }  # fmt: skip


def test_a_flat_response_tells_no_mode() -> None:
    at = np.arange(900.0, 1101.0, 12.5)
    assert start_values.resonance(at, [1.0 + 0.01 * RNG.standard_normal(len(at)) + 0j]) is None


def test_every_searched_parameter_of_the_catalogue_says_its_range() -> None:
    assert searched_by("dry_friction") is searched_by("dry_friction:2") is Search.SPEEDS
    assert searched_by("cubic_stiffness") is None
    assert searched_by("an_effect_of_my_own") is None
