"""Emulator and observer share no physics, and say the same names, symbols and units."""

import pytest

from device_emulator.effects.kinds import DECLARATIONS
from estimator.effects.catalogue import EFFECTS

OF_TRACING = {effect.name: effect for effect in EFFECTS}
IN_BOTH = sorted(DECLARATIONS.keys() & OF_TRACING.keys())

OTHERWISE = {
    "base_vibration": "a sine by frequency, amplitudes and phases: how one is measured",
    "interference": "a sine by frequency, amplitudes and phases: how one is measured",
    "dry_friction_asymmetric": "with the friction that it is a share of",
    "drive_saturation": "a limit of each axis",
    "drive_dead_band": "a band of each axis",
    "sense_clipping": "a limit in volts: the amplifiers'",
    "drive_feedthrough": "in volts: the amplifiers'",
    "temperature_offset": "in volts: the amplifiers'",
    "temperature_stiffness": "relative: the material's",
    "temperature_damping": "relative: the gas'",
}
"""What a scenario states in other numbers than an observer estimates, and why."""

ONLY_TRACED = {
    "of the sense chain and the clock, in sections of their own": {"sense_low_pass", "sense_high_pass", "clock_rate"},
}


def test_an_effect_of_both_has_one_name() -> None:
    assert OF_TRACING.keys() - DECLARATIONS.keys() == set().union(*ONLY_TRACED.values())


def test_what_is_stated_otherwise_is_in_both() -> None:
    assert OTHERWISE.keys() <= set(IN_BOTH)


@pytest.mark.parametrize("name", [name for name in IN_BOTH if name not in OTHERWISE])
def test_an_effect_of_both_has_the_same_symbols_and_units(name: str) -> None:
    units = {coefficient.symbol: coefficient.unit for coefficient in DECLARATIONS[name].coefficients}
    effect = OF_TRACING[name]
    asked = {item.name: item.unit for item in (*effect.coefficients, *effect.parameters)}
    if name == "parasitic_mode":
        assert units.pop("frequency") == "Hz"  # as a spectrum shows it
        assert asked.pop("omega") == "1/s"
    if name == "sense_gain":
        assert units.pop("gx") == "1"  # the scale of length, which no observer can estimate
    assert units == asked
