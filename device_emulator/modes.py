"""`[truth]` by resonances and quality factors: keys that may stand for stiffness and damping.

A resonance f with a split s is f + s/2 along the azimuth and f - s/2 across it. Written for the emulator alone, like
all of its physics.
"""

import math
from typing import Any

KEYS = {
    "resonance_Hz": "instead of stiffness_N_per_m: mean of the two resonances",
    "split_Hz": "beside it: resonance along azimuth_deg less that across; without it 0",
    "azimuth_deg": "beside split_Hz: direction of the first axis from x; without it 0",
    "q": "instead of damping_N_s_per_m: quality factor at the mean resonance; one number, or [along, across]",
    "decay_time_s": "instead of damping_N_s_per_m: time in which the amplitude falls to 1/e; one, or [along, across]",
    "damping_azimuth_deg": "beside two numbers of those: direction of the first from x; without it 0",
}
_WAYS = (("stiffness_N_per_m", "resonance_Hz"), ("damping_N_s_per_m", "q", "decay_time_s"))
_BESIDE = {"split_Hz": ("resonance_Hz",), "azimuth_deg": ("split_Hz",), "damping_azimuth_deg": ("q", "decay_time_s")}


def in_matrices(table: dict[str, Any]) -> dict[str, Any]:
    """`[truth]` with stiffness and damping for the keys above. Raises ValueError that names the keys."""
    if not any(key in table for key in KEYS):
        return table
    for ways in _WAYS:
        if len(given := [key for key in ways if key in table]) > 1:
            raise ValueError(f"{', '.join(given)}: one quantity given in two ways; give one of them")
    for key, partners in _BESIDE.items():
        if key in table and not any(partner in table for partner in partners):
            raise ValueError(f"{key}: stands beside {' or '.join(partners)}; give that too, or leave it out")
    number = {key: _numbers(key, table[key]) for key in KEYS if key in table}
    mass = table.get("mass_kg")
    rest = {key: value for key, value in table.items() if key not in KEYS}
    if isinstance(mass, bool) or not isinstance(mass, int | float):
        return rest  # what is wrong with it is told of the key itself
    if "resonance_Hz" in number:
        f, split = number["resonance_Hz"][0], number.get("split_Hz", [0.0])[0]
        if f <= 0.0 or abs(split) >= 2.0 * f:
            raise ValueError("resonance_Hz: expected a number greater than 0, and split_Hz below twice that")
        along, across = (mass * (2.0 * math.pi * one) ** 2 for one in (f + 0.5 * split, f - 0.5 * split))
        rest["stiffness_N_per_m"] = _turned(along, across, number.get("azimuth_deg", [0.0])[0])
    losses = number.get("q") or number.get("decay_time_s")
    if losses:
        if min(losses) <= 0.0 or len(losses) > 2:
            raise ValueError(f"{'q' if 'q' in number else 'decay_time_s'}: expected one or two numbers greater than 0")
        per_loss = mass * _mean_rad_s(rest.get("stiffness_N_per_m"), mass) if "q" in number else 2.0 * mass
        turn = number.get("damping_azimuth_deg", [0.0])[0]
        rest["damping_N_s_per_m"] = _turned(per_loss / losses[0], per_loss / losses[-1], turn)
    return rest


def _numbers(key: str, value: Any) -> list[float]:
    values = value if isinstance(value, list) and key in ("q", "decay_time_s") else [value]
    for one in values:
        if isinstance(one, bool) or not isinstance(one, int | float) or not math.isfinite(one):
            raise ValueError(f"{key}: expected a number, got {one!r}")
    return [float(one) for one in values]


def _turned(along: float, across: float, azimuth_deg: float) -> list[float]:
    """[xx, yy, xy] of `along` at the azimuth and `across` at right angles to it."""
    c, s = math.cos(math.radians(azimuth_deg)), math.sin(math.radians(azimuth_deg))
    return [along * c * c + across * s * s, along * s * s + across * c * c, (along - across) * c * s]


def _mean_rad_s(stiffness: Any, mass: float) -> float:
    """Mean of the two angular resonances; 1 where there is no stiffness to tell, which its own key refuses."""
    if not isinstance(stiffness, list) or len(stiffness) != 3 or not all(type(k) in (int, float) for k in stiffness):
        return 1.0
    xx, yy, xy = stiffness
    root = math.sqrt((xx - yy) ** 2 + 4.0 * xy * xy)
    squared = [(xx + yy + sign * root) / (2.0 * mass) for sign in (1.0, -1.0)]
    return 0.5 * sum(math.sqrt(max(one, 0.0)) for one in squared)
