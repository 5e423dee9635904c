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

Other readouts have a map of the displacement between rest gain and motion: two plates x/(1 - (x/Z)²), a lens
x (1 + κ r²), a tunnelling tip (exp(a x) - 1)/a; the gain of strain gauges follows the temperature. The shot noise of a
tunnelling current grows with the current.

Φ, as the truth file tells it, is all that a channel shows besides gain × displacement, white noise and hidden
effects.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from device_emulator.effects.catalogue import delay_s
from device_emulator.faults import MAX_SENSE_FAULTS, Saturated
from device_emulator.flicker import MAX_FLICKER_POLES, flicker_constants
from device_emulator.scenario import GapClosing, Optical, Piezo, Piezoresistive, Scenario, Sense, Tunnelling

ELEMENTARY_CHARGE_C = 1.602176634e-19
_CURVES = {"gap_closing": 1, "optical": 2, "tunnelling": 3}  # as native/sense.h counts them
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
        ("curve", "i8"),  # which map acts on the displacement
        ("bend", "f8", 2),  # its constant: gap [m], distortion [1/m²], decay [1/m]
        ("tempco_per_K", "f8", 2),
        ("shot_V2", "f8", 2),  # variance of a sample that grows as the current does, at rest
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
    """Gain of x and y at rest: -(2V/Cf) N ε (W/Z) in V/m, equation (5), -Rf η in V per m/s of a layer, and so on."""
    s = scenario.sense
    if isinstance(s, Piezo):
        both = [-ohm * charge for ohm, charge in zip(s.feedback_ohm, s.charge_C_per_m, strict=True)]
    elif isinstance(s, GapClosing):
        per_cf = [-2.0 * s.bias_V * s.permittivity_F_per_m / cf for cf in s.feedback_F]
        both = [k * area / gap**2 for k, area, gap in zip(per_cf, s.area_m2, s.gap_m, strict=True)]
    elif isinstance(s, Optical):
        both = [m / pitch for m, pitch in zip(s.magnification, s.pixel_m, strict=True)]
    elif isinstance(s, Piezoresistive):
        both = [-s.supply_V * g * strain for g, strain in zip(s.gauge_factor, s.strain_per_m, strict=True)]
    elif isinstance(s, Tunnelling):
        both = [-r * i * a for r, i, a in zip(s.feedback_ohm, s.current_A, s.decay_per_m, strict=True)]
    else:
        both = [
            -2.0 * s.bias_V / cf * n * s.permittivity_F_per_m * w / z
            for cf, n, w, z in zip(s.feedback_F, s.fingers, s.width_m, s.gap_m, strict=True)
        ]
    return both[0], both[1]


def sense_constants(scenario: Scenario, substep_s: float) -> NDArray[Any]:
    """The chain as its kernels read it, shape (1,) of dtype `SENSE`."""
    s = scenario.sense
    fs = scenario.true_rate_Hz
    constants = np.zeros(1, SENSE)
    c = constants[0]
    c["gain_V_per_m"] = sense_gain(scenario)
    if isinstance(s, Piezo):
        _enter_layers(c, s)
    elif isinstance(s, Sense):
        _enter_combs(c, s)
    else:
        _enter_curve(c, s, fs)
    c["drift_V_per_s"] = s.drift_V_per_s
    c["random_walk_V"] = s.random_walk_V_per_rts / math.sqrt(fs)
    c["noise_V"] = s.noise_V
    flicker = flicker_constants(s.flicker_V_at_1Hz, fs)[0]
    for name, own in (
        ("flicker_poles", "poles"),
        ("flicker_V", "rms"),
        ("flicker_keep", "keep"),
        ("flicker_add", "add"),
    ):
        c[name] = flicker[own]
    c["lsb_V"] = 2.0 * s.adc_full_scale_V / 2**s.adc_bits
    c["code_max"] = 2 ** (s.adc_bits - 1) - 1
    for axis in range(2):
        c["high_pass"][axis] = _first_order(c["leak_per_s"][axis], substep_s)
        low_pass_Hz = s.low_pass_Hz[axis] if isinstance(s, Sense) else math.inf
        c["low_pass"][axis] = _first_order(2.0 * math.pi * low_pass_Hz, substep_s)
        c["tracked"] |= c["leak_per_s"][axis] > 0.0 or math.isfinite(low_pass_Hz)
    c["delay_substeps"] = np.array(delay_s(scenario.effect, "sense_delay")) / substep_s
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


def _enter_curve(constants: Any, sense: GapClosing | Optical | Piezoresistive | Tunnelling, rate_Hz: float) -> None:
    constants["opamp_V"] = sense.offset_V
    constants["curve"] = _CURVES.get(sense.kind, 0)
    if isinstance(sense, GapClosing):
        constants["bend"] = sense.gap_m
    elif isinstance(sense, Optical):
        constants["bend"] = sense.distortion_per_m2
    elif isinstance(sense, Piezoresistive):
        constants["tempco_per_K"] = sense.temperature_per_K
    else:
        constants["bend"] = sense.decay_per_m
        ohm, ampere = np.array(sense.feedback_ohm), np.array(sense.current_A)
        constants["shot_V2"] = ohm**2 * 2.0 * ELEMENTARY_CHARGE_C * ampere * 0.5 * rate_Hz


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
