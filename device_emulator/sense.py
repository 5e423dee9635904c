"""Sense chain: comb capacitors into a charge integrator, or piezoelectric layers into a current amplifier, then a
converter; from physical constants.

    ΔC = N ε (W/Z) x,   Co1 - Co2 = 2 N ε (W/Z) d                                           (3)
    Vo = -(2V/Cf) ΔC - (Co1 - Co2) V/Cf + (Co1 + Co2 + Cp + Cf) Vos/Cf                      (4)

so a fixed gain -(2V/Cf) N ε (W/Z), an offset Φ, and noise (5). The feedback resistor Rf, which the circuit
has, makes the integrator a high-pass with the time constant Rf Cf: it is released at tick 0 as (4) has it,
then the mismatch decays and Vos keeps the gain 1. A low-pass pole may follow. Filters and delay act on the
exact trajectory, not on samples.

A layer sets the charge η x free, a current η ẋ that the amplifier turns into

    Vo + Rf Cf V̇o = -Rf η ẋ + (1 + Rf/Rs) Vos + Rf Ib

which is a velocity below the corner 1/(2π Rf Cf) and a displacement above. It is the same circuit as the integrator
with its resistor, -(η/Cf) (x - w) with ẇ = (x - w)/(Rf Cf), and so is carried; at tick 0 it has settled long ago.

Φ, as the truth file tells it, is all that a channel shows besides gain × displacement, white noise and hidden
effects.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from device_emulator.effects.catalogue import delay_s
from device_emulator.effects.sense import SenseKind
from device_emulator.faults import MAX_SENSE_FAULTS, Saturated
from device_emulator.scenario import Piezo, Scenario, Sense

MAX_FLICKER_POLES = 12
_LOWEST_FLICKER_HZ = 1e-3
_NODES = 6  # of the polynomial that reads the delayed trajectory; error 1e-10 of the amplitude

SENSE = np.dtype(
    [
        ("gain_V_per_m", "f8", 2),  # per m/s where the velocity itself is shown
        ("mismatch_V", "f8", 2),
        ("opamp_V", "f8", 2),
        ("opamp_gain", "f8", 2),  # (Co1 + Co2 + Cp) / Cf
        ("leak_per_s", "f8", 2),  # 1 / (Rf Cf)
        ("drift_V_per_s", "f8", 2),
        ("random_walk_V", "f8"),  # per sample
        ("noise_V", "f8"),
        ("flicker_poles", "i8"),
        ("flicker_V", "f8", MAX_FLICKER_POLES),  # rms of each
        ("flicker_keep", "f8", MAX_FLICKER_POLES),
        ("flicker_add", "f8", MAX_FLICKER_POLES),
        ("lsb_V", "f8"),
        ("code_max", "i8"),
        ("tracked", "i8"),  # whether filters or delays need the trajectory between samples
        ("current", "i8", 2),  # 1: of a piezoelectric layer; without a leak it shows the velocity itself
        ("high_pass", "f8", (2, 5)),
        ("low_pass", "f8", (2, 5)),
        ("delay_substeps", "f8", 2),
        # Faults: on `axis`, ticks `first` to `last`, the code stays (limit -1) or is held within ± limit.
        ("faults", "i8"),
        ("fault_axis", "i8", MAX_SENSE_FAULTS),
        ("fault_first", "i8", MAX_SENSE_FAULTS),
        ("fault_last", "i8", MAX_SENSE_FAULTS),
        ("fault_limit", "i8", MAX_SENSE_FAULTS),
    ],
    align=True,
)

# What the chain remembers.
SENSE_STATE = np.dtype(
    [
        ("seen", "f8", (2, 2)),  # displacement and its rate at the last sub-step, per axis
        ("leaked", "f8", 2),  # low-passed displacement that the high-pass takes away
        ("smooth", "f8", 2),  # output of the low-pass
        ("newest", "i8"),  # row of `history` written last
        ("random_walk", "f8", 2),
        ("flicker", "f8", (2, MAX_FLICKER_POLES)),
        ("shown", "i8", 2),  # code of the last row
    ],
    align=True,
)


def sense_gain(scenario: Scenario) -> tuple[float, float]:
    """Gain of x and y, negative: -(2V/Cf) N ε (W/Z) in V/m, equation (5), or -Rf η in V per m/s of a layer."""
    s = scenario.sense
    if isinstance(s, Piezo):
        x, y = (-ohm * charge for ohm, charge in zip(s.feedback_ohm, s.charge_C_per_m, strict=True))
        return x, y
    x, y = (
        -2.0 * s.bias_V / cf * n * s.permittivity_F_per_m * w / z
        for cf, n, w, z in zip(s.feedback_F, s.fingers, s.width_m, s.gap_m, strict=True)
    )
    return x, y


def sense_constants(scenario: Scenario, substep_s: float) -> NDArray[Any]:
    """The chain as its kernels read it, shape (1,) of dtype `SENSE`."""
    s = scenario.sense
    fs = scenario.true_rate_Hz
    constants = np.zeros(1, SENSE)
    c = constants[0]
    c["gain_V_per_m"] = sense_gain(scenario)
    if isinstance(s, Piezo):
        _enter_layers(c, s)
    else:
        _enter_combs(c, s)
    c["drift_V_per_s"] = s.drift_V_per_s
    c["random_walk_V"] = s.random_walk_V_per_rts / math.sqrt(fs)
    c["noise_V"] = s.noise_V
    # 1/f noise of density F at 1 Hz: first-order processes a decade apart, each of variance F² ln 10, sum to
    # F²/f within 6 % from 1 mHz to a quarter of the sample rate. Sampling folds what lies above half the rate
    # back; each variance is lowered so that the density below its corner is that of the unsampled process.
    if s.flicker_V_at_1Hz > 0.0:
        poles = min(MAX_FLICKER_POLES, 1 + math.ceil(math.log10(0.5 * fs / _LOWEST_FLICKER_HZ)))
        corner = 0.5 * fs * 10.0 ** -np.arange(poles)
        keep = np.exp(-2.0 * np.pi * corner / fs)
        c["flicker_poles"] = poles
        fold = fs / (np.pi * corner) * (1.0 - keep) / (1.0 + keep)
        c["flicker_V"][:poles] = s.flicker_V_at_1Hz * np.sqrt(math.log(10.0) * fold)
        c["flicker_keep"][:poles] = keep
        c["flicker_add"] = c["flicker_V"] * np.sqrt(1.0 - c["flicker_keep"] ** 2)
    c["lsb_V"] = 2.0 * s.adc_full_scale_V / 2**s.adc_bits
    c["code_max"] = 2 ** (s.adc_bits - 1) - 1
    for axis in range(2):
        c["high_pass"][axis] = _first_order(c["leak_per_s"][axis], substep_s)
        low_pass_Hz = math.inf if isinstance(s, Piezo) else s.low_pass_Hz[axis]
        c["low_pass"][axis] = _first_order(2.0 * math.pi * low_pass_Hz, substep_s)
        c["tracked"] |= c["leak_per_s"][axis] > 0.0 or math.isfinite(low_pass_Hz)
    c["delay_substeps"] = np.array(delay_s(scenario.effect, SenseKind.SENSE_DELAY)) / substep_s
    _enter_faults(c, scenario)
    c["tracked"] |= bool((c["delay_substeps"] > 0.0).any())
    return constants


def _enter_combs(constants: Any, sense: Sense) -> None:
    constants["mismatch_V"] = constants["gain_V_per_m"] * sense.mismatch_m
    constants["opamp_V"] = sense.opamp_offset_V
    cf = np.array(sense.feedback_F)
    per_m = np.array(sense.fingers) * sense.permittivity_F_per_m * np.array(sense.width_m) / np.array(sense.gap_m)
    rest = 2.0 * per_m * sense.overlap_m  # Co1 + Co2: twice the one at rest
    constants["opamp_gain"] = (rest + sense.parasitic_F) / cf
    constants["leak_per_s"] = 1.0 / (np.array(sense.feedback_ohm) * cf)


def _enter_layers(constants: Any, sense: Piezo) -> None:
    rf, cf, ib = np.array(sense.feedback_ohm), np.array(sense.feedback_F), np.array(sense.bias_A)
    constants["opamp_V"] = np.array(sense.opamp_offset_V) * (1.0 + rf / np.array(sense.source_ohm)) + rf * ib
    constants["current"] = 1
    cornered = cf > 0.0
    constants["leak_per_s"] = np.divide(1.0, rf * cf, out=np.zeros(2), where=cornered)
    # Of x - w, which is ẋ Rf Cf below the corner.
    constants["gain_V_per_m"] *= np.where(cornered, constants["leak_per_s"], 1.0)


def _enter_faults(constants: Any, scenario: Scenario) -> None:
    faults, rate = scenario.faults, scenario.board.sample_rate_Hz
    for k, fault in enumerate([*faults.stuck, *faults.saturated]):
        constants["fault_axis"][k] = "xy".index(fault.axis)
        constants["fault_first"][k] = math.ceil(fault.start_s * rate)
        constants["fault_last"][k] = math.ceil((fault.start_s + fault.duration_s) * rate) - 1
        limit = fault.limit_V / constants["lsb_V"] if isinstance(fault, Saturated) else -1
        constants["fault_limit"][k] = int(limit)
        constants["faults"] = k + 1


def history_rows(sense: NDArray[Any]) -> int:
    """Rows of trajectory that the longest delay reaches back over."""
    return int(sense["delay_substeps"].max()) + 2 * _NODES


def _first_order(pole_per_s: float, h: float) -> tuple[float, float, float, float, float]:
    """Weights (w0; p0, ṗ0, p1, ṗ1) that carry ẇ = a (p - w) over h exactly for a cubic p."""
    z = pole_per_s * h
    if math.isinf(z):
        return 0.0, 0.0, 0.0, 1.0, 0.0
    # J[n] = ∫ z e^{-z(1-s)} s^n ds over 0..1: by parts, for small z by the series in which nothing cancels.
    j = [-math.expm1(-z)]
    for n in range(1, 4):
        series = (-((-z) ** k) * math.factorial(n) / math.factorial(n + k) for k in range(1, 25))
        j.append(sum(series) if z < 1.0 else 1.0 - n * j[-1] / z)
    blend = 3.0 * j[2] - 2.0 * j[3]
    return math.exp(-z), j[0] - blend, h * (j[1] - 2.0 * j[2] + j[3]), blend, h * (j[3] - j[2])
