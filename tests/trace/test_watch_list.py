"""What is watched on a record, with which parameters: as estimator/thresholds.py says, written out."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from estimator.custom import Coefficient, Declaration, Parameter
from estimator.effects.catalogue import EFFECTS
from estimator.effects.labels import kind
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
def test_corners_lie_in_the_band_and_speeds_are_shares_of_the_motion() -> None:
    found, seen = watched(record()), record()
    slowest = 1.0 / float(seen.step.sum())
    for label, part in ((1, 1 / 3), (2, 2 / 3)):
        corner = pytest.approx(slowest ** (1 - part) * OMEGA0**part)
        assert found[f"sense_high_pass:{label}"] == {"leak_x": corner, "leak_y": corner}
        half = pytest.approx(0.5 * float(np.mean(seen.step)) ** (1 - part) * OMEGA0**-part)
        assert found[f"sense_low_pass:{label}"] == {"tlx": half, "tly": half}
    assert found["sense_low_pass"] == {"tlx": 0.0, "tly": 0.0}
    for name in ("dry_friction", "dry_friction_asymmetric"):
        for label, share in ((1, 0.01), (2, 0.1)):
            assert found[f"{name}:{label}"] == {"v0": pytest.approx(share * 2e-4 * OMEGA0)}
    names = {name for name in found if kind(name) in ("sense_high_pass", "dry_friction")}
    assert names == {"sense_high_pass:1", "sense_high_pass:2", "dry_friction:1", "dry_friction:2"}


@pytest.mark.moderate
def test_thresholds_are_shares_of_what_drive_and_motion_reach() -> None:
    """The drive is declared in units of 3 m/s²; each channel reaches by its own gain."""
    found = watched(record())
    force = 3.0 * np.abs(DRIVE[:, :, 0])
    for label, share in enumerate((0.04, 0.12, 0.3, 0.55, 0.75, 0.92), start=1):
        assert found[f"drive_saturation:{label}"] == {"limit": pytest.approx(share * 6.0)}
    for label, share in enumerate((0.02, 0.06, 0.15, 0.5), start=1):
        assert found[f"drive_dead_band:{label}"] == {"band": pytest.approx(share * np.sqrt(np.mean(force**2)))}
    for label, share in enumerate((0.6, 0.75, 0.9, 0.98), start=1):
        assert found[f"sense_clipping:{label}"] == {"level": pytest.approx(share * 0.09 / 445.0)}


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


def spoken(monkeypatch: pytest.MonkeyPatch, seen: Any, *peaks: tuple[int, float]) -> dict[str, Any]:
    """What is watched where the coherence has these peaks (bin, height) and one mode is seen near each, or none."""
    length = 1500  # an eighth of the record
    coherence = np.zeros(length // 2 + 1)
    for at, height in peaks:
        coherence[at] = height

    def cross_density(drive: Array, residual: Array, rate: float, segment: int) -> tuple[Array, Array]:
        assert (rate, segment) == (pytest.approx(RATE), length)
        return np.fft.rfftfreq(length, 1.0 / RATE), np.sqrt(0.5 * coherence) + 0j

    def power_density(series: Array, rate: float, segment: int) -> tuple[Array, Array]:
        return np.fft.rfftfreq(length, 1.0 / RATE), np.ones(length // 2 + 1)

    asked = []

    def resonance(omega: Array, responses: list[Array]) -> tuple[float, float] | None:
        asked.append((omega, [len(one) for one in responses]))
        return seen

    monkeypatch.setattr(start_values, "cross_density", cross_density)
    monkeypatch.setattr(start_values, "power_density", power_density)
    monkeypatch.setattr(start_values, "resonance", resonance)
    monkeypatch.setattr("estimator.trace.candidates.rings", lambda residuals, sample_rate, itself: [])
    found = watched(record())
    width = 2.0 * np.pi * RATE / length
    for omega, lengths in asked:
        np.testing.assert_allclose(np.diff(omega), width)
        assert omega[0] >= width  # never at frequency zero
        assert lengths == [len(omega)] * 2
    return {name: given for name, given in found.items() if kind(name) == "parasitic_mode"}


def test_a_mode_is_watched_where_it_is_seen_and_at_its_bin(monkeypatch: pytest.MonkeyPatch) -> None:
    """The three highest peaks, the highest first; a bin is 8/3 Hz wide, the resonance at bin 75 and its peak 8 wide."""
    peaks = (5, 0.7), (68, 0.9), (75, 1.0), (82, 0.95), (100, 0.3), (300, 0.5), (740, 0.4)
    bin_width = 2.0 * np.pi * RATE / 1500
    found = spoken(monkeypatch, (999.0, 0.02), *peaks)
    assert {name: given["omega"] for name, given in found.items() if name.endswith("2")} == {
        "parasitic_mode:12": pytest.approx(5 * bin_width),
        "parasitic_mode:22": pytest.approx(300 * bin_width),
        "parasitic_mode:32": pytest.approx(740 * bin_width),
    }
    assert {given["zeta"] for name, given in found.items() if name.endswith("2")} == {0.005}
    assert [found[f"parasitic_mode:{k}1"] for k in (1, 2, 3)] == [{"omega": 999.0, "zeta": 0.02}] * 3
    assert len(found) == 6


def test_where_no_mode_is_seen_the_bin_alone_is_watched(monkeypatch: pytest.MonkeyPatch) -> None:
    found = spoken(monkeypatch, None, (66, 0.9), (84, 0.8))
    bin_width = 2.0 * np.pi * RATE / 1500
    assert found == {
        "parasitic_mode:11": {"omega": pytest.approx(66 * bin_width), "zeta": 0.005},
        "parasitic_mode:21": {"omega": pytest.approx(84 * bin_width), "zeta": 0.005},
    }


def test_a_plateau_of_two_bins_is_one_peak(monkeypatch: pytest.MonkeyPatch) -> None:
    found = spoken(monkeypatch, None, (300, 1.0), (301, 1.0))
    assert len(found) == 1


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


@pytest.mark.parametrize(("samples", "segment"), [(8 * 5000, 4096), (8 * 1500 + 7, 1500)])
def test_a_response_is_of_eight_segments_at_least(samples: int, segment: int) -> None:
    long = Record(np.zeros((samples, 1)), np.zeros((samples, 1, 1)), np.ones(samples))
    assert start_values._segment(long) == segment


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


@pytest.mark.parametrize(
    ("dither", "elsewhere"), [(0.02, {"parasitic_mode:1": math.sqrt(OMEGA0 * math.pi * RATE)}), (0.04, None)]
)  # a thousandth of the power is 0.0316 of the amplitude's rms
def test_where_the_drive_is_of_the_resonance_alone_one_mode_stands_for_all(
    dither: float, elsewhere: dict[str, float] | None
) -> None:
    line = np.sin(OMEGA0 * np.arange(N) / RATE)[:, None] * np.array([1.0, 0.3])
    drive = line + dither * np.sqrt(np.mean(line**2)) * RNG.standard_normal((N, 2))
    found = watched(Record(SENSE, drive[:, :, None], np.full(N, 1.0 / RATE)))
    modes = {name: given["omega"] for name, given in found.items() if kind(name) == "parasitic_mode"}
    assert (modes == pytest.approx(elsewhere)) if elsewhere is not None else ("parasitic_mode:1" not in modes and modes)
