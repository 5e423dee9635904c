"""The bench file of a device that was identified: each value with its uncertainty, what no record tells marked."""

from typing import Any

import numpy as np

from hil.bench import Bench
from hil.bench.template import IN_MPS2, put_in, template
from hil.identifying.findings import Findings
from hil.identifying.recording import full_scale_mps2
from hil.identifying.request import IdentifyRequest
from hil.numbers import significant
from hil.toml.reading import parse_table, table_of

_UNTOLD = "NOT TOLD by a record"
_DELAY = "measured of drive and sense together: neither is longer, as none is negative"


def values_of(found: Findings, name: str, mass_kg: float | None) -> dict[str, dict[str, Any]]:
    """By section and key, as `hil.bench.template` takes them."""
    mass = 1.0 if mass_kg is None else mass_kg
    omega, rate = found.omega, found.identity.tick_rate_Hz
    gains = [found.value(f"gain_{axis}") for axis in "xy"]
    product = max(found.u(f"gain_{axis}") / abs(gain) for axis, gain in zip("xy", gains, strict=True))
    shares = [np.hypot(found.value(one), found.u(one)) for one in ("share_xy", "share_yx")]
    delay_s = float(np.hypot(found.value("delay"), found.u("delay"))) / rate
    measured: dict[str, dict[str, Any]] = {
        "device": {
            "name": name,
            "axes": 2,
            "mass_kg": mass,
            "stiffness_N_per_m": [mass * found.value(one) for one in ("kxx", "kyy", "kxy")],
            "damping_N_s_per_m": [mass * found.value(one) for one in ("dxx", "dyy", "dxy")],
            "sample_rate_Hz": rate,
        },
        "device.sense": {
            "gain_V_per_m": gains,
            "noise_V": float(np.max(found.noise_V)),
            "offset_sd_V": float(max(abs(found.value(f"offset_{axis}")) for axis in "xy")),
        },
        "device.drive": {"full_scale": full_scale_mps2(found.identity), **IN_MPS2},
        "device.calibration": {
            "drive_gain_u": min(max(product, 1e-9), 0.5),
            "drive_misalignment_u": float(min(max(*shares, 1e-9), 0.5)),
            "drive_delay_u_s": max(delay_s, 1e-12),
            "sense_delay_u_s": max(delay_s, 1e-12),
        },
        "observer.initial": {"offset_V": [found.value(f"offset_{axis}") for axis in "xy"]},
        "observer.initial_sd": {
            "offset_V": float(3.0 * max(found.u(f"offset_{axis}") for axis in "xy") + 1e-3 * np.max(found.noise_V))
        },
        "controller": {"target_stiffness_N_per_m": mass * omega**2},
        "loop": {"name": name},
    }
    return put_in(measured, found.settings)


def text_of(found: Findings, name: str, mass_kg: float | None, link: str | None) -> str:
    """The file."""
    values = values_of(found, name, mass_kg)
    if link is not None:
        values = put_in(values, {"link": {"url": link}})
    board = found.identity
    heading = [f"Identified: board {board.unique_id:016x}, firmware {board.version}. ± is 95 %."]
    if found.advice is not None:
        heading += ["Predicted of these settings on this board:", *found.advice.sentences, *found.advice.missed]
    return template(values, "\n# ".join(heading), remarks(found, mass_kg))


def bench_of(found: Findings, request: IdentifyRequest) -> Bench:
    """The file as `hil run` will read it."""
    text = text_of(found, request.name, request.mass_kg, request.kept_link)
    return parse_table(table_of(text.encode(), request.name), Bench, request.name)


def remarks(found: Findings, mass_kg: float | None) -> dict[tuple[str, str], str]:
    """What is said of a key beside its meaning, by section and key."""
    mass = 1.0 if mass_kg is None else mass_kg

    def spread(names: str, factor: float = 1.0) -> str:
        return "± [" + ", ".join(significant(2.0 * factor * found.u(name), 2) for name in names.split()) + "]"

    product = (
        "the product with the drive's scale, which IDENTITY states: a known force or displacement tells them apart"
    )
    return {
        ("device", "mass_kg"): f"{_UNTOLD}: it scales N and N/m only" if mass_kg is None else "as given",
        ("device", "stiffness_N_per_m"): spread("kxx kyy kxy", mass),
        ("device", "damping_N_s_per_m"): spread("dxx dyy dxy", mass),
        ("device", "amplitude_m"): "proposed: what drive and sense range allow",
        ("device.sense", "gain_V_per_m"): f"{spread('gain_x gain_y')}, {product}",
        (
            "device.sense",
            "noise_V",
        ): f"± {significant(2.0 * float(np.max(found.noise_V)) / np.sqrt(2.0 * found.rows), 2)}",
        ("device.calibration", "angular_gain"): f"{_UNTOLD} of a board at rest: measure it with a known rotation",
        ("device.calibration", "clock_u"): f"{_UNTOLD}: a clock beside the board's tells it",
        ("device.calibration", "drive_gain_u"): "of the product, as measured; the drive's own scale is IDENTITY's word",
        ("device.calibration", "drive_misalignment_u"): "as measured, with the sense channels' cross coupling in it",
        ("device.calibration", "drive_delay_u_s"): _DELAY,
        ("device.calibration", "sense_delay_u_s"): _DELAY,
        (
            "device.calibration",
            "sense_gain_ratio_u",
        ): f"{_UNTOLD} apart from the drive's: exchange the drives of x and y",
        ("device.calibration", "sense_cross_coupling_u"): f"{_UNTOLD} apart from the drive's misalignment",
        ("observer.initial", "offset_V"): spread("offset_x offset_y"),
    }
