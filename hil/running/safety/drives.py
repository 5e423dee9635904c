"""What a start would drive a board with, whole, in words: consent is given to this, wherever it is asked for.

It is made from the bench as it will run, with every setting in it, so that the terminal, the HTTP interface and the
page show one list, and nothing drives that is not on it.
"""

import hashlib
from collections.abc import Iterable
from typing import NamedTuple

from hil.bench import Bench


class Fact(NamedTuple):
    """A line of it: what it is called, and its value with unit."""

    name: str
    value: str


def drives(bench: Bench, link: str, declared: Bench | None = None) -> tuple[Fact, ...]:
    """What a run of `bench` at `link` brings the board; `declared` is the bench file, where settings changed it: what
    differs is told beside its value.
    """
    before = {} if declared is None else dict(_values(declared))
    told = []
    for name, value in _values(bench):
        changed = declared is not None and before.get(name) != value
        was = before.get(name, "off")
        told.append(Fact(name, f"{value} (a setting; the bench file says {was})" if changed else value))
    return (Fact("link", link), *told)


def in_one_line(facts: Iterable[Fact]) -> str:
    return ", ".join(f"{name} {value}" for name, value in facts)


def digest(facts: Iterable[Fact]) -> str:
    """A short text that is another one wherever `facts` are others: what somebody consented to, and nothing else."""
    return hashlib.sha256(repr([tuple(fact) for fact in facts]).encode()).hexdigest()[:16]


def _values(bench: Bench) -> list[Fact]:
    loop, limits = bench.loop, bench.limits
    facts = [("length", f"{loop.duration_s:g} s"), ("loop", f"{loop.clock}, {loop.mode} mode")]
    if not bench.controller.enabled:
        facts.append(("drive", "held at zero"))
    else:
        facts += _drive(bench)
    facts += [
        ("watchdog", f"{bench.watchdog_s:g} s"),
        ("SAFE above", f"{limits.residual_safe:g} × the noise, by the innovation"),
        ("armed again", f"{limits.rearm} times at most, after a stop that the host accounts for"),
    ]
    return [Fact(*fact) for fact in facts]


def _drive(bench: Bench) -> list[tuple[str, str]]:
    device, controller = bench.device, bench.controller
    declared = f"{device.drive.full_scale:g} {_UNITS[device.drive.unit]}"
    most = bench.drive_limit_mps2
    whole = device.drive.unit == "mps2" and most == device.drive_full_scale_mps2
    scale = "" if whole else f", of a full scale of {declared}"
    stiffness = bench.target_stiffness_per_s2 * device.mass_kg
    facts = [
        ("largest drive", f"{float(most):.6g} m/s²{scale}"),
        ("amplitude", f"{1e6 * device.amplitude_m:.6g} µm"),
        ("target stiffness", f"{stiffness:.6g} N/m"),
        ("virtual rotation", f"{controller.virtual_rotation_rad_s:.6g} rad/s"),
        ("dither", f"{controller.dither_mps2:.6g} m/s² rms"),
        ("gains", f"energy {controller.energy_gain:g}, quadrature {controller.quadrature_gain:g}"),
    ]
    if controller.virtual_reversal_s:
        facts.append(("rotation reverses", f"every {bench.virtual_reversal_s:.6g} s"))
    if controller.amplitude_modulation:
        share = 100.0 * controller.amplitude_modulation
        facts.append(("amplitude modulation", f"± {share:g} % at {controller.modulation_Hz:g} Hz"))
    if controller.stiffness_step:
        facts.append(
            ("stiffness steps", f"± {100.0 * controller.stiffness_step:g} % at {controller.stiffness_step_Hz:g} Hz")
        )
    return facts


_UNITS = {"mps2": "m/s²", "N": "N", "V": "V"}
