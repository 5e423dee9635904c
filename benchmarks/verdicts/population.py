"""Which runs there are: devices as `make undeclared` draws them, and the edges of what anybody would connect.

Verdict and uncertainty were developed on draws 101 to 109; figures are of a draw that they had not been tried on.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from evaluation.undeclared.device import bench_table, draw_device, draw_rate, scenario_table
from evaluation.undeclared.effects import DRAWABLE, EFFECTS, Rng
from evaluation.undeclared.population import Order

DRAW = 110
SAMPLES = 40_000
SINGLE, CLEAN, EXTREME = 240, 60, 40
EXTREMES = ("snr_1", "bits_8", "mismatch_40", "open_loop", "clock", "angular_gain")

_OFF = (0.01, 0.05)  # by which a clock or an angular gain is off, drawn uniformly and of either sign …
_DECLARED_OFF = 0.03  # … and what the bench file declares of it, a standard uncertainty


@dataclass(frozen=True)
class Planned:
    """One run: its order, scenario and bench file as tables, whether the drive is held at zero."""

    order: Order
    scenario: dict[str, Any]
    bench: dict[str, Any]
    open_loop: bool


def population(draw: int, share: float = 1.0) -> list[Order]:
    """The runs of a draw, kinds interleaved; `share` of each category, of which a larger share keeps the smaller."""
    ranked: list[tuple[float, Order]] = []
    for category, kinds, count in (
        ("single", tuple(DRAWABLE), SINGLE),
        ("clean", (), CLEAN),
        ("extreme", EXTREMES, EXTREME),
    ):
        for i in range(max(round(share * count), 1)):
            effects = (kinds[i % len(kinds)],) if kinds else ()
            order = Order(category, effects, i // max(len(kinds), 1), draw)
            ranked.append(((i + 0.5) / count, order))
    return [order for _, order in sorted(ranked, key=lambda one: one[0])]


def plan(order: Order, samples: int = SAMPLES) -> Planned:
    """The device of `order`, what its data sheet declares, and how it is run."""
    rng = np.random.default_rng(order.seed)
    extreme = order.effects[0] if order.category == "extreme" else ""
    hidden = [EFFECTS[name] for name in order.effects] if order.category == "single" else []
    device = draw_device(rng, crest=1.3, slow=any(drawable.slow for drawable in hidden))
    duration_s = samples / device.sample_rate_Hz
    scenario = scenario_table(device, draw_rate(rng, device, duration_s), order.seed)
    for drawable in hidden:
        drawn = drawable.draw(rng, device)
        scenario.setdefault("effect", []).extend(drawn.effects)
        for section, keys in drawn.sections.items():
            scenario[section] = scenario.get(section, {}) | keys
    bench = bench_table(device, duration_s, excited=True, turning=True)
    bench["loop"]["name"] = order.name.replace("_", "-")
    bench["limits"] = {"energy_error": 1.0}  # the amplitude is modulated; all others are a user's own
    if extreme:
        _to_the_edge(extreme, rng, scenario, bench)
    return Planned(order, scenario, bench, extreme == "open_loop")


def _to_the_edge(extreme: str, rng: Rng, scenario: dict[str, Any], bench: dict[str, Any]) -> None:
    sense, declared = scenario["sense"], bench["device"]["sense"]
    off = float(rng.choice([-1, 1]) * rng.uniform(*_OFF))
    if extreme == "snr_1":
        sense["noise_V"] = declared["noise_V"] = abs(declared["gain_V_per_m"]) * bench["device"]["amplitude_m"]
        sense["adc_full_scale_V"] = 1.0
    elif extreme == "bits_8":
        sense["adc_bits"] = 8
        step = 2.0 * sense["adc_full_scale_V"] / 2**8
        declared["noise_V"] = math.hypot(sense["noise_V"], step / math.sqrt(12.0))
    elif extreme == "mismatch_40":
        for table, key in ((scenario["truth"], "stiffness_N_per_m"), (bench["device"], "stiffness_N_per_m")):
            kxx, kyy, kxy = table[key]
            table[key] = [1.2 * kxx, 0.8 * kyy, kxy]
        for table, key in ((scenario["drive"], "full_scale_mps2"), (bench["device"]["drive"], "full_scale")):
            table[key] *= 4.0
    elif extreme == "clock":
        scenario["faults"] = {"clock_skew": off}
        bench["device"]["calibration"] = {"clock_u": _DECLARED_OFF}
    elif extreme == "angular_gain":
        scenario.setdefault("effect", []).append({"name": "angular_gain", "kappa": off})
        bench["device"]["calibration"] = {"angular_gain_u": _DECLARED_OFF}
