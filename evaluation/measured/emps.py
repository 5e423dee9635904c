"""EMPS: friction named in the force domain, then the free run of the same model."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from estimator.effects.catalogue import effect_for
from estimator.observer import Observer
from estimator.refinement import refine
from estimator.scaling import Array, Scaling
from estimator.trace.free_run import free_run_error, verdict_of
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
from evaluation.measured.outcome import MeasuredRow, Outcome, Panel, Say, rms
from hil.records.capture import Capture

FOLDER = "emps"
FILES = ("DATA_EMPS.mat", "DATA_EMPS_PULSES.mat")  # to fit, to test
_FILTERS = Filters(position=60.0, force=20.0, every=25)
_FIRST = 20  # outputs of the test that set the state and are not scored
_CHOICE = 0.6  # of the first file, on which candidates compete; the rest must agree
_WEAK = 1e-3  # 1/s²
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
    without, with_them = (1e3 * rms(_free_run(fit, *captures)) for fit in (found.before, found.after))
    rows.append(MeasuredRow(FOLDER, "pulses", "free-run RMSE", "mm", without, with_them, verdict, effects))
    words = (
        "Position and its derivatives behind a Butterworth filter of 60 Hz run both ways, then both sides of the "
        "equation of motion behind one of 20 Hz and resampled to 40 Hz, as in the data set's own identification. "
        "Effects are chosen on the first file, on 60 % of it, where the rest must agree; the second, with pulses of "
        "force, is scored. The free run in mm is that of a mass on no spring: what is left of the force adds up to "
        "a drift over 25 s, so that this figure says less than the one in N."
    )
    motion = motion_in(captures[1])
    time = np.arange(len(after)) * _FILTERS.every / motion.rate
    panel = Panel(
        "emps", "EMPS, second file: force that the model lacks", time, "time, s",
        [("before", before), ("after", after)], "N",
    )  # fmt: skip
    return Outcome("EMPS", rows, [words, _described(found.after, found.evidence, found.rejected)], [panel])


def forces(first: Capture, second: Capture) -> tuple[ForceTrace, Array, Array]:
    """What the first file lacks of its force, fitted to the whole of it; residual (rows,) N of the second, before and
    after.
    """
    device, _ = declared("emps")
    scaling = Scaling(float(np.sqrt(device.target)), device.amplitude, device.sense_gain, device.drive_gain)
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


def _free_run(found: ForceFit, first: Capture, second: Capture) -> Array:
    """Residual of a free run on the second record, refined by simulation error on the first from the forces found."""
    device, settings = declared("emps")
    values = dict(zip(found.names, found.values, strict=True))
    mass = values["inertia"]
    effects = {
        name: {c.name: values[c.name] / mass for c in effect_for(name, 1)[1].coefficients} for name in found.effects
    }
    # A force that is always there has no place in the base model but as the pull of a spring, here one too weak to be
    # seen, towards a place far away.
    initial = {"kxx": _WEAK, "dxx": values["damping"] / mass, "drive_gain_x": 1.0 / mass}
    observer = Observer(device, replace(settings, effects=effects, initial=initial))
    record = record_of(first)
    start = observer.state.copy()
    start[0] = record.sense[0, 0] / device.sense_gain[0]
    free = tuple(name for name in observer.estimated if name != "kxx")
    fitted = refine(observer, record.sense, record.drive, start=start, free=free, step=record.step)
    return free_run_error(observer, fitted, record_of(second), _FIRST)[_FIRST:]


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
