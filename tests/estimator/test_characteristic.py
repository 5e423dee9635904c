"""Laws of one characteristic, against the equations that the page of effects prints."""

import pytest
import sympy as sp

from estimator.effects.catalogue import EFFECTS
from estimator.effects.characteristic import Characteristic, characteristic
from estimator.effects.declaration import Source
from estimator.effects.search import Kin
from estimator.model.gyro import vx, vy, x, y
from estimator.trace.engine import Estimate
from estimator.trace.promises import one_curve

SURE = {"c": Estimate(0.05, 0.04, 0.06)}

LAWS = {
    Characteristic.SENSE: {"sense_quadratic", "sense_cubic", "sense_clipping"},
    Characteristic.DRIVE: {"electrostatic_drive", "drive_saturation", "drive_dead_band"},
    Characteristic.SPRING: {
        "cubic_stiffness", "cubic_isotropic", "quadratic_stiffness", "quintic_stiffness", "quintic_isotropic",
    },
    Characteristic.DAMPING: {
        "nonlinear_damping", "nonlinear_damping_radial", "dry_friction", "dry_friction_radial", "stribeck_friction",
        "dry_friction_asymmetric", "damping_asymmetric", "drag", "drag_radial", "cubic_damping", "cubic_damping_radial",
    },
}  # fmt: skip
"""By hand, from docs/reference/effects.md."""


@pytest.mark.parametrize("which", Characteristic)
def test_the_laws_of_a_characteristic_are_those_that_depend_on_the_same_axis_now(which: Characteristic) -> None:
    assert {effect.name for effect in EFFECTS if characteristic(effect) is which} == LAWS[which]


def test_even_laws_are_those_that_do_not_change_with_the_sign_of_the_motion() -> None:
    """Of a vibration they show a shift and its second harmonic, each of which another one draws as well."""
    even = set()
    for effect in EFFECTS:
        directions = [signal.symbol for signal in effect.signals if signal.source is Source.DIRECTION]
        motion = [x, y, vx, vy, *directions]
        laws = [*effect.sense, *effect.force]
        turned = [sp.sympify(law).subs({one: -one for one in motion}, simultaneous=True) for law in laws]
        moves = any(sp.sympify(law).free_symbols & set(motion) for law in laws)
        if moves and all(sp.simplify(new - law) == 0 for new, law in zip(turned, laws, strict=True)):
            even.add(effect.name)
    assert {effect.name for effect in EFFECTS if effect.kin is Kin.EVEN} == even


def test_three_laws_of_one_characteristic_are_terms_of_a_series() -> None:
    named = {"sense_cubic": SURE, "drag": SURE, "sense_clipping:a": SURE, "sense_quadratic": SURE}
    (said,) = one_curve(named)
    assert said.startswith("sense cubic and sense clipping and sense quadratic are laws of one curve, ")
    assert "what a channel reads of the displacement" in said
    assert "something acts like them" in said


@pytest.mark.parametrize(
    "named",
    [
        ("sense_cubic", "sense_quadratic"),  # a channel may well have both
        ("sense_cubic", "sense_quadratic", "cubic_stiffness", "quadratic_stiffness"),
        ("sense_delay", "sense_low_pass", "sense_cross_coupling", "interference"),
        ("sense_gain", "sense_cubic", "sense_quadratic"),  # a slope and two terms of the shape
        ("temperature_stiffness", "cubic_stiffness", "quadratic_stiffness"),
    ],
)
def test_two_of_a_kind_and_others_are_what_they_are_called(named: tuple[str, ...]) -> None:
    assert one_curve(dict.fromkeys(named, SURE)) == ()


def test_what_is_not_of_the_catalogue_is_a_law_of_nothing_known() -> None:
    assert one_curve(dict.fromkeys(("drag", "cubic_damping", "leak"), SURE)) == ()
