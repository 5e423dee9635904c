"""EMPS: friction named in the force domain, then the free run of the same model."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from estimator.effects.catalogue import effect_for
from estimator.scaling import Array, Scaling
from evaluation.measured.carriage import Carriage, fitted, turnover, with_stribeck
from evaluation.measured.inverse_dynamics import (
    Filters,
    ForceFit,
    ForceTrace,
    Motion,
    fit_forces,
    motion_of,
    trace_forces,
)
from evaluation.measured.oscillator import declared, imported, record_of
from evaluation.measured.outcome import MeasuredRow, Outcome, Say, rms, verdict_of
from hil.records.capture import Capture

FOLDER = "emps"
FILES = ("DATA_EMPS.mat", "DATA_EMPS_PULSES.mat")  # to fit, to test
_FILTERS = Filters(position=60.0, force=20.0, every=25)
_FIRST = 20  # outputs of the test that set the state and are not scored
_CHOICE = 0.6  # of the first file, on which candidates compete; the rest must agree
_RIPPLE = 1.5  # N rms, force ripple of the motor within the band: what a model without it cannot reach


def measure(data: Path, work: Path, say: Say) -> Outcome:
    """Name and fit on the first file, score on the second, in N and in mm."""
    captures = [imported(data / file, work, "emps") for file in FILES]
    say("emps: force domain")
    found, before, after = forces(*captures)
    effects = list(found.after.effects)
    verdict = verdict_of(rms(before), rms(after), _RIPPLE, effects).value
    rows = [MeasuredRow(FOLDER, "pulses", "force-domain RMSE", "N", rms(before), rms(after), verdict, effects)]
    say("emps: free run")
    plain, full = free_runs(found, captures[0])
    second = record_of(captures[1])
    without, with_them = (1e3 * rms(one.error_on(second, _FIRST)) for one in (plain, full))
    named = [effect.name for _, effect in full.observer.effects]
    rows.append(MeasuredRow(FOLDER, "pulses", "free-run RMSE", "mm", without, with_them, verdict, named))
    words = (
        "Position and its derivatives behind a Butterworth filter of 60 Hz run both ways, then both sides of the "
        "equation of motion behind one of 20 Hz and resampled to 40 Hz, as in the data set's own identification. "
        "Effects are chosen on the first file, on 60 % of it, where the rest must agree; the second, with pulses of "
        "force, is scored."
    )
    free = (
        "The free run in mm is the benchmark's own metric: from rest, nothing corrected, 20 samples not scored. The "
        "same friction, refined by the error of the free run of the first file, with static friction beside it that "
        f"falls with the speed; that file is then left with {1e3 * full.rmse:.2f} mm ({1e3 * plain.rmse:.2f} without "
        "effects). Friction turns over within what the velocity changes by in one sample where the carriage turns. A "
        "mass on no spring adds up what is left of the force: 0.05 N there or less move this figure by millimetres."
    )
    forced = _described(found.after, found.evidence, found.rejected)
    return Outcome("EMPS", rows, [words, forced, free, _refined(full)])


def forces(first: Capture, second: Capture) -> tuple[ForceTrace, Array, Array]:
    """What the first file lacks of its force, fitted to the whole of it; residual (rows,) N of the second, before and
    after.
    """
    device, _ = declared("emps")
    scaling = Scaling.of(device)
    edge = int(_CHOICE * len(first))
    chosen = trace_forces(motion_in(first.part(0, edge)), motion_in(first.part(edge, len(first))), scaling)
    before, after = (fit_forces(motion_in(first), effects, scaling) for effects in ((), chosen.after.effects))
    found = replace(chosen, before=before, after=after)
    scored = motion_in(second)
    return found, before.residual_on(scored, scaling), after.residual_on(scored, scaling)


def motion_in(capture: Capture) -> Motion:
    """Position and force of a capture."""
    device, _ = declared("emps")
    position = capture.sense_V[:, 0] / device.sense_gain[0]
    return motion_of(position, capture.drive[:, 0], device.sample_rate, _FILTERS)


def free_runs(found: ForceTrace, first: Capture) -> tuple[Carriage, Carriage]:
    """The carriage without effects and with those found, static friction beside them, each refined by the free run of
    the first record from what the force domain found.
    """
    device, settings = declared("emps")
    rest = turnover(motion_in(first))
    record = record_of(first)
    plain = fitted(device, settings, record, _constants(found.before), _pull(found.before))
    fit = found.after
    effects = _pull(fit) | {name: _per_mass(fit, name) for name in fit.effects}
    effects["dry_friction"]["v0"] = rest
    return plain, with_stribeck(device, settings, record, _constants(fit), effects)


def _constants(fit: ForceFit) -> dict[str, float]:
    values = dict(zip(fit.names, fit.values.tolist(), strict=True))
    return {"dxx": values["damping"] / values["inertia"], "drive_gain_x": 1.0 / values["inertia"]}


def _pull(fit: ForceFit) -> dict[str, dict[str, float]]:
    """What the motor's current shows beside its force: an offset, which acts as a constant force."""
    values = dict(zip(fit.names, fit.values.tolist(), strict=True))
    return {"constant_force": {"ax": -values["offset"] / values["inertia"]}}


def _per_mass(fit: ForceFit, name: str) -> dict[str, float]:
    values = dict(zip(fit.names, fit.values.tolist(), strict=True))
    return {c.name: values[c.name] / values["inertia"] for c in effect_for(name, 1)[1].coefficients}


def _refined(full: Carriage) -> str:
    """What the free run found, in Markdown."""
    mass = 1.0 / full.fit.value("drive_gain_x")
    lines = [f"- inertia = {mass:.4g} kg, damping = {mass * full.fit.value('dxx'):.4g} N·s/m"]
    for _, effect in full.observer.effects:
        given = full.observer.settings.effects[effect.name]
        for c in effect.coefficients:
            unit = "N" if c.unit == "m/s²" else f"kg·{c.unit}"
            half = mass * 0.5 * float(np.diff(full.fit.interval(c.name))[0])
            lines.append(f"- **{effect.name}**: {c.name} = {mass * full.fit.value(c.name):.4g} ± {half:.2g} {unit}")
        speeds = [f"{p.name} = {1e3 * given[p.name]:.3g} mm/s" for p in effect.parameters]
        lines[-1] += f" ({', '.join(speeds)})" if speeds else ""
    return "\n".join(lines)


def _described(fit: ForceFit, evidence: dict[str, float], rejected: dict[str, str]) -> str:
    units = {"inertia": "kg", "damping": "N·s/m", "stiffness": "N/m", "offset": "N"}
    for name in fit.effects:
        for c in effect_for(name, 1)[1].coefficients:
            units[c.name] = "N" if c.unit == "m/s²" else f"kg·{c.unit}"
    lines = [
        f"- {name} = {value:.4g} ± {half:.2g} {units[name]}"
        for name, value, half in zip(fit.names, fit.values, fit.half_widths, strict=True)
    ]
    lines += [f"- **{name}**: evidence {gain:.0f}" for name, gain in evidence.items()]
    lines += [f"- left out: {name}, which {reason}" for name, reason in rejected.items() if reason.startswith("fits")]
    return "\n".join(lines)
