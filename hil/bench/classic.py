"""The loops that vibrating gyroscopes are run with, instead of the source's control law: [controller] mode."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field

from hil.bench.section import NotNegative, Positive, Section

Mode = Literal["whole_angle", "force_to_rebalance", "mode_reversal", "classic_whole_angle"]
CLASSIC: tuple[Mode, ...] = ("force_to_rebalance", "mode_reversal", "classic_whole_angle")
"""Modes of the plug-in that comes with the bench, in the order of its own numbers from 1."""
PLUGIN = "classic"
"""Its name, as `Observer.plugin` and `Controller.plugin` have it."""
PROBED = ("none", "amplitude", "phase", "rate", "quadrature")


class Loops(Section):
    """The loops of all modes but whole_angle: each has a proportional and integral filter, designed from the frequency
    at which the open loop's gain is 1, and from the phase margin there.
    """

    amplitude_Hz: Positive | None = None
    """bandwidth of the amplitude loop (gain 1 of the open loop); without it a fiftieth of the declared resonance, as of
    the loops below"""
    phase_Hz: Positive | None = None
    """bandwidth of the phase-locked loop"""
    rate_Hz: Positive | None = None
    """bandwidth of the loop that balances the rate by a force; in classic_whole_angle of the one that follows the
    pattern"""
    quadrature_Hz: Positive | None = None
    """bandwidth of the quadrature loop"""
    phase_margin_deg: Annotated[float, Field(gt=10, lt=85)] = 60.0
    """phase margin of each loop"""
    exchange_s: Positive | None = None
    """mode_reversal: time from one exchange of drive and sense axes to the next; without it four times what exchange
    and settling take"""
    search_s: Positive | None = None
    """longest time in which the resonance has to be found; without it a thousand cycles"""
    ring_up_s: Positive | None = None
    """longest time in which the amplitude has to reach 95 % of its set point; without it five times what half of the
    drive needs, and sixty time constants of its loop"""
    lock_s: Positive | None = None
    """longest time in which phase and amplitude have to settle; without it a hundred time constants of the loop"""
    null_s: Positive | None = None
    """longest time in which the motion across the drive has to be nulled; without it two hundred time constants"""
    probe: Literal["none", "amplitude", "phase", "rate", "quadrature"] = "none"
    """loop whose gain and phase margin are measured while it is closed, by a small sine"""
    probe_Hz: Positive = 1.0
    """frequency of that sine"""
    probe_size: NotNegative = 1e-4
    """its size: of the resonance for the phase and for the pattern's turn, of resonance times amplitude for the rest"""

    def options(self, mode: Mode) -> dict[str, float]:
        """As the plug-in takes them."""
        given = {name: getattr(self, name) for name in type(self).model_fields if name != "probe"}
        return {
            **{name: value for name, value in given.items() if value is not None},
            "mode": CLASSIC.index(mode) + 1.0,
            "probe_loop": float(PROBED.index(self.probe)),
        }


def name_plugin(table: Any) -> Any:
    """A bench's tables with the plug-in of their mode in both places, and without it where the mode has none.

    Raises ValueError for another plug-in beside such a mode.
    """
    if not isinstance(table, Mapping):
        return table
    sections = {name: table.get(name, {}) for name in ("observer", "controller")}
    if not all(isinstance(section, Mapping) for section in sections.values()):
        return table
    mode = sections["controller"].get("mode")
    changed: dict[str, Any] = {}
    for name, section in sections.items():
        plugin = section.get("plugin")
        if mode in CLASSIC and plugin not in (None, PLUGIN):
            raise ValueError(f'[{name}] plugin: [controller] mode = "{mode}" has its own; take one of the two out')
        if mode in CLASSIC:
            changed[name] = {**section, "plugin": PLUGIN}
        elif plugin == PLUGIN:
            changed[name] = {key: value for key, value in section.items() if key != "plugin"}
    return {**table, **changed}
