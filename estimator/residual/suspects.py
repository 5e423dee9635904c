"""Which effects a finding points at.  A pointer, not a proof: it orders the search and words the report.

Sources: the signatures of the effects' own declarations (`estimator.effects`).
"""

from collections.abc import Mapping

_ODD = (
    "cubic_stiffness",
    "cubic_isotropic",
    "sense_cubic",
    "dry_friction",
    "nonlinear_damping",
    "cubic_damping",
    "drag",
    "sense_clipping",
    "drive_saturation",
    "drive_dead_band",
)
_EVEN = (
    "quadratic_stiffness",
    "sense_quadratic",
    "dry_friction_asymmetric",
    "damping_asymmetric",
    "electrostatic_drive",
)
_LINEAR = (
    "sense_gain",
    "sense_cross_coupling",
    "nonreciprocal_stiffness",
    "drive_gain",
    "drive_misalignment",
    "drive_delay",
    "sense_delay",
    "sense_low_pass",
    "cubic_stiffness",
    "cubic_isotropic",
)

SUSPECTS: Mapping[str, tuple[str, ...]] = {
    "line at 0": (*_EVEN, "sense_high_pass", "constant_force"),
    "line at 1": _LINEAR,
    "line at 2": _EVEN,
    "line at 3": _ODD,
    "line at 4": _EVEN,
    "line at 5": _ODD,
    "line elsewhere": ("interference", "base_vibration", "parasitic_mode"),
    "always": (*_LINEAR, "nonlinear_damping", "dry_friction"),
    "amplitude": ("cubic_stiffness", "cubic_isotropic", "sense_cubic", "nonlinear_damping", "dry_friction"),
    "sin 2θ": ("sense_gain", "sense_delay", "drive_gain", "drive_delay", "cubic_stiffness"),
    "cos 2θ": ("sense_cross_coupling", "drive_misalignment", "nonreciprocal_stiffness"),
    "sin 4θ": ("cubic_stiffness", "sense_cubic", "nonlinear_damping"),
    "cos 4θ": ("cubic_stiffness", "sense_cubic", "nonlinear_damping"),
    "rate": ("sense_delay", "drive_delay", "nonreciprocal_stiffness"),
    "drive": ("drive_feedthrough", "drive_gain", "drive_misalignment", "drive_delay", "parasitic_mode"),
    "temperature": ("temperature_stiffness", "temperature_damping", "temperature_offset"),
    "floor": ("drive_feedthrough",),
}
"""Sign in the residual → effects, by name."""


def suspects(sign: str) -> tuple[str, ...]:
    """Effects that `sign` points at."""
    return SUSPECTS[sign]
