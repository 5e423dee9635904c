"""Settings of the controller that can change while the loop runs, and which of them a bench has to begin anew for."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

from pydantic import BaseModel, ConfigDict, Field

from hil.bench import Bench
from hil.bench.bench import override

if TYPE_CHECKING:  # the service asks what may be set, and needs no estimator for it
    from estimator.observer import Observer

_STEP = 0.2  # of the target stiffness: as far as [controller] stiffness_step goes
_SWING = 0.5, 1.5  # of the declared amplitude


class Settings(BaseModel):
    """What may be asked for; what is left out stays. Units and limits are those of the bench file."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, strict=True)

    target_stiffness: float | None = Field(default=None, gt=0.0)
    """[controller] target_stiffness_N_per_m"""
    amplitude: float | None = Field(default=None, gt=0.0)
    """[device] amplitude_m"""
    virtual_rotation: float | None = None
    """[controller] virtual_rotation_rad_s"""
    dither: float | None = Field(default=None, ge=0.0)
    """[controller] dither_mps2"""

    @property
    def given(self) -> dict[str, float]:
        return {name: value for name, value in self.model_dump().items() if value is not None}


def in_force(bench: Bench) -> dict[str, float]:
    controller = bench.controller
    return {
        "target_stiffness": bench.target_stiffness_per_s2 * bench.device.mass_kg,
        "amplitude": bench.device.amplitude_m,
        "virtual_rotation": controller.virtual_rotation_rad_s,
        "dither": controller.dither_mps2,
    }


def with_settings(bench: Bench, settings: Mapping[str, float]) -> Bench:
    """A bench that begins with `settings`. Raises InputError where that is none."""
    names = {
        "target_stiffness": ("controller", "target_stiffness_N_per_m"),
        "amplitude": ("device", "amplitude_m"),
        "virtual_rotation": ("controller", "virtual_rotation_rad_s"),
        "dither": ("controller", "dither_mps2"),
    }
    changes: dict[str, dict[str, float]] = {}
    for name, value in settings.items():
        section, key = names[name]
        changes.setdefault(section, {})[key] = value
    return override(bench, changes, "settings") if changes else bench


def at_once(bench: Bench, settings: Mapping[str, float]) -> dict[str, str]:
    """Why each of `settings` has to wait for the next start, "" for one that the running loop of `bench` can take.

    Gain mode's dither is the board's own, and the host predicts it bit by bit; its filter is made for the target
    frequency, as the scale of all numbers is.
    """
    declared, controller = in_force(bench), bench.controller
    reasons = dict.fromkeys(settings, "")
    if not controller.enabled or bench.device.axes != 2:
        return dict.fromkeys(settings, "the loop drives nothing")
    if controller.plugin is not None:
        return dict.fromkeys(settings, "the plug-in of [controller] drives, which is made with them")
    if bench.loop.mode == "board":
        return dict.fromkeys(settings, "the board's own controller drives, which is built with them")
    if "dither" in settings and bench.loop.mode == "gain":
        reasons["dither"] = "in gain mode the board adds it, from a register that is written before it is armed"
    if "target_stiffness" in settings:
        change = abs(settings["target_stiffness"] / declared["target_stiffness"] - 1.0)
        if controller.stiffness_step:
            reasons["target_stiffness"] = "[controller] stiffness_step moves it already"
        elif bench.loop.mode == "gain":
            reasons["target_stiffness"] = "in gain mode the board's filter is made for it"
        elif not change <= _STEP:
            reasons["target_stiffness"] = f"while the loop runs it changes by {_STEP:.0%} at most"
    if "amplitude" in settings:
        least, most = _SWING
        if not least <= settings["amplitude"] / declared["amplitude"] <= most:
            reasons["amplitude"] = f"while the loop runs it is {least:g} to {most:g} of the declared one"
    return reasons


class LiveSettings:
    """Changes them in the observer of a running loop; only what `at_once` lets through is to be asked.

    In the observer of a replay too, at the ticks that the run noted.
    """

    def __init__(self, observer: "Observer", bench: Bench) -> None:
        self._observer = observer
        self._declared = in_force(bench)
        self._now = dict(self._declared)

    def change(self, settings: Mapping[str, float]) -> dict[str, float]:
        """Have `settings` act from the next sample on; all that is in force then."""
        changed = {name for name, value in settings.items() if value != self._now[name]}
        self._now |= settings
        now, declared = self._now, self._declared
        if "target_stiffness" in changed or "amplitude" in changed:
            self._observer.retarget(
                now["target_stiffness"] / declared["target_stiffness"], now["amplitude"] / declared["amplitude"]
            )
        if "virtual_rotation" in changed:
            self._observer.turn(now["virtual_rotation"])
        if "dither" in changed:
            self._observer.dither(now["dither"])
        return dict(now)
