"""docs/safety.md, The host, rule 3: sense levels plausible beside the declared amplitude, gain, offset and noise.

Each bound is held from both sides, near enough that one twice as large or as small would show.
"""

import math
from typing import Any

import numpy as np
import pytest

from hil.bench import Bench
from hil.bench.device import Device
from hil.running.safety.opening import Levels
from tests.running import gyro
from tests.running.misbehaving import Board

SCALE_V = 0.25 / 2**15
NOISE_V = 89e-6
SWING_V = 885.42 * 100e-6
N = 400


def levels(**sense: Any) -> Levels:
    return Levels(declared(**sense), Board().identity)


def declared(**sense: Any) -> Bench:
    sense = {"gain_V_per_m": -885.42, "noise_V": NOISE_V} | sense
    return gyro.unhurried_bench(1.0, device={"amplitude_m": 100e-6, "sense": sense})


def codes(x_V: float = 0.0, y_V: float = 0.0, *, middle_V: float = 0.0, noise_V: float = NOISE_V) -> np.ndarray:
    """Both channels swinging at 20 Hz about `middle_V`, in codes of 16 bits."""
    t = np.arange(N) / 400.0
    volts = middle_V + np.outer(np.sin(2 * np.pi * 20.0 * t), [x_V, y_V])
    volts += noise_V * np.random.default_rng(1).standard_normal((N, 2))
    return np.clip(np.rint(volts / SCALE_V), -(2**15), 2**15 - 1).astype(np.int64)


def on(axis: str, odd: np.ndarray, usual: np.ndarray) -> np.ndarray:
    """The odd channel on one axis, the usual one on the other."""
    return np.column_stack([odd[:, 0], usual[:, 1]] if axis == "x" else [usual[:, 0], odd[:, 1]])


@pytest.mark.parametrize("swing", [0.0, 0.01, 1.0, 2.0])
def test_a_mass_at_rest_or_swinging_as_declared_is_plausible(swing: float) -> None:
    assert levels().wrong(codes(swing * SWING_V, swing * SWING_V)) == ""
    assert levels().wrong(codes(swing * SWING_V, 0.0)) == ""


@pytest.mark.parametrize("axis", ["x", "y"])
@pytest.mark.parametrize("at", [0, 1234, 2**15 - 1, -(2**15)])
def test_a_channel_that_stands_still_is_named(axis: str, at: int) -> None:
    told = levels().wrong(on(axis, np.full((N, 2), at), codes(SWING_V, SWING_V)))
    assert told.startswith(f"sense {axis} stands still at {at * SCALE_V:.3g} V")


def test_one_that_changes_once_does_not_stand_still() -> None:
    still = np.zeros((N, 2), np.int64)
    still[200:] = 1
    assert levels().wrong(still) == ""


def test_a_channel_with_less_noise_than_half_a_code_may_stand_still() -> None:
    assert levels(noise_V=0.1 * SCALE_V).wrong(np.zeros((N, 2), np.int64)) == ""
    assert "stands still" in levels(noise_V=0.6 * SCALE_V).wrong(np.zeros((N, 2), np.int64))


@pytest.mark.parametrize("axis", ["x", "y"])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_channel_at_either_end_of_its_converter_is_named(axis: str, sign: int) -> None:
    usual = codes(SWING_V, SWING_V)
    told = levels().wrong(on(axis, codes(0.4, 0.4, middle_V=sign * 0.2), usual))
    assert told.startswith(f"sense {axis} is at the end of its converter in ")
    wide = levels(gain_V_per_m=-2400.0)  # ± 0.24 V are meant to be there
    assert wide.wrong(codes(0.24, 0.24)) == ""


def test_a_glitch_or_two_are_no_end_of_a_converter() -> None:
    usual = codes(0.24, 0.24)
    usual[[100, 300], 0] = 2**15 - 1
    assert levels(gain_V_per_m=-2400.0).wrong(usual) == ""


@pytest.mark.parametrize("axis", ["x", "y"])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_channel_far_from_its_declared_offset_is_named(axis: str, sign: int) -> None:
    usual = codes(0.5 * SWING_V, 0.5 * SWING_V)
    told = levels().wrong(on(axis, codes(middle_V=sign * 0.24), usual))
    assert told.startswith(f"sense {axis} sits at {sign * 0.24:.3g} V")


def test_an_offset_as_declared_is_plausible() -> None:
    for offset in (0.03, -0.03):
        assert levels(offset_sd_V=0.02).wrong(codes(0.02, 0.02, middle_V=offset)) == ""
    quiet = {"offset_sd_V": 1e-4, "gain_V_per_m": -100.0}  # ± 10 mV of swing
    assert "sits at" in levels(**quiet).wrong(codes(middle_V=0.03))
    assert levels(**quiet).wrong(codes(middle_V=0.008)) == ""  # a slow mass may stand anywhere within its swing


@pytest.mark.parametrize("axis", ["x", "y"])
def test_a_channel_that_swings_far_beyond_the_declared_amplitude_is_named(axis: str) -> None:
    small = levels(gain_V_per_m=-100.0)
    usual = codes(0.01, 0.01)
    told = small.wrong(on(axis, codes(0.1, 0.1), usual))
    assert told.startswith(f"sense {axis} swings by 0.1 V")
    assert small.wrong(codes(0.02, 0.02)) == ""
    assert levels(gain_V_per_m=100.0).wrong(codes(0.02, 0.02)) == ""  # the sign of a gain is no size


@pytest.mark.parametrize("offset", [0.1, -0.1])
def test_a_swing_is_counted_from_where_the_channel_sits(offset: float) -> None:
    small = levels(gain_V_per_m=-100.0, offset_sd_V=0.05)
    assert small.wrong(codes(0.01, 0.01, middle_V=offset)) == ""
    assert "swings by" in small.wrong(codes(0.1, 0.1, middle_V=offset))


def test_noise_alone_is_no_swing() -> None:
    noisy = levels(gain_V_per_m=-1.0, noise_V=5e-3)
    assert noisy.wrong(codes(noise_V=5e-3)) == ""
    assert noisy.wrong(codes(noise_V=5e-3, middle_V=0.01)) == ""  # two deviations off: noise of low frequency
    assert "swings by" in noisy.wrong(codes(0.1, 0.1, noise_V=5e-3))


def test_of_a_single_axis_only_that_is_looked_at() -> None:
    bench = declared()
    single = bench.model_copy(update={"device": bench.device.model_copy(update={"axes": 1})})
    still = on("y", np.zeros((N, 2), np.int64), codes(SWING_V, SWING_V))
    assert Levels(single, Board().identity).wrong(still) == ""
    assert "sense y stands still" in Levels(bench, Board().identity).wrong(still)


def test_they_are_judged_by_the_rows_of_acquisition_or_a_cycle() -> None:
    def rows(acquisition_s: float) -> int:
        bench = declared()
        observer = bench.observer.model_copy(update={"acquisition_s": acquisition_s})
        return Levels(bench.model_copy(update={"observer": observer}), Board().identity).rows

    assert rows(1.0) == 400
    assert rows(2.5) == 1000
    assert rows(1000.0) <= 20_000  # a bound in time and memory
    cycle = 400.0 / declared().device.resonance_Hz
    assert cycle <= rows(0.0) < 10 * cycle
    device = declared().device
    for resonance_Hz in (0.5, 2.5):
        stiffness = device.mass_kg * (2.0 * math.pi * resonance_Hz) ** 2
        slow = device.model_copy(update={"stiffness_N_per_m": (stiffness, stiffness, 0.0), "sample_rate_Hz": 400.0})
        assert slow.resonance_Hz == pytest.approx(resonance_Hz)
        assert rows_of(slow) == math.ceil(400.0 / slow.resonance_Hz)
    assert rows_of(slow.model_copy(update={"stiffness_N_per_m": (0.0, 0.0, 0.0)})) == 50  # no spring, no cycle


def rows_of(device: Device) -> int:
    """Of a bench without acquisition."""
    bench = declared()
    observer = bench.observer.model_copy(update={"acquisition_s": 0.0})
    return Levels(bench.model_copy(update={"observer": observer, "device": device}), Board().identity).rows


@pytest.mark.parametrize(("equal", "told"), [(40, False), (49, False), (50, True), (60, True)])
def test_half_a_hundred_equal_codes_stand_still_fewer_may_be_chance(equal: int, told: bool) -> None:
    assert ("stands still" in levels().wrong(np.zeros((equal, 2), np.int64))) == told


@pytest.mark.parametrize(("clipped", "told"), [(6, False), (8, False), (10, True), (14, True)])
def test_one_sample_in_fifty_at_the_end_of_the_converter_is_borne(clipped: int, told: bool) -> None:
    usual = codes(0.2, 0.2)
    usual[:clipped, 0] = 2**15 - 1
    assert ("end of its converter" in levels(gain_V_per_m=-2400.0).wrong(usual)) == told


@pytest.mark.parametrize(("amplitudes", "told"), [(2.5, False), (2.9, False), (3.2, True), (5.0, True)])
def test_three_amplitudes_are_borne(amplitudes: float, told: bool) -> None:
    small = levels(gain_V_per_m=-100.0)
    assert ("swings by" in small.wrong(codes(amplitudes * 0.01, amplitudes * 0.01))) == told


@pytest.mark.parametrize(("deviations", "told"), [(4.0, False), (5.8, False), (6.2, True), (10.0, True)])
def test_six_deviations_of_the_offset_are_borne_beside_the_swing(deviations: float, told: bool) -> None:
    quiet = levels(offset_sd_V=0.01, gain_V_per_m=-1.0, noise_V=1e-5)
    assert ("sits at" in quiet.wrong(codes(middle_V=deviations * 0.01, noise_V=1e-5))) == told


@pytest.mark.parametrize(("deviations", "told"), [(5.0, False), (7.0, True)])
def test_six_deviations_of_the_noise_are_borne_where_nothing_swings(deviations: float, told: bool) -> None:
    """Of the mean, and of a single sample."""
    noise_V = 100.0 * SCALE_V
    resting = levels(gain_V_per_m=-0.1, offset_sd_V=0.0, noise_V=noise_V)
    off = round(deviations * noise_V / SCALE_V)
    flicker = np.tile([[0], [1]], (N // 2, 2))  # so that it does not stand still
    assert ("sits at" in resting.wrong(off + flicker)) == told
    flicker[7] = off
    assert ("swings by" in resting.wrong(flicker)) == told
