"""The scan that closes every run and replay: the capture read in stretches, the estimator's answer for result.json."""

import time
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hil.bench import Bench
from hil.bench.ratio import path_of
from hil.progress import Progress, Watcher
from hil.records.result import Lacking, Parameter, Scan, Unexcluded
from hil.records.runfolder import RunFolder
from hil.records.table import scored_from_s

if TYPE_CHECKING:
    from estimator.completeness import answer
    from estimator.completeness.information import Information
    from hil.records.capture import Capture


def scan_run(folder: RunFolder, bench: Bench, progress: Watcher) -> "answer.Completeness | None":
    """What the record of a run says of its model; None where none was kept, and of demodulated streams.

    Memory is bounded by the stretches that are looked at, not by the record.
    """
    if folder.capture is None or not len(folder.capture) or folder.capture.carrier_Hz is not None:
        return None
    from hil.inputs.captured import at_rest

    progress(Progress("scan", 0, 0))
    capture, bench, _ = at_rest(folder.capture, bench, folder.trims)
    return scan_of(capture, bench, progress)


def scan_of(capture: "Capture", bench: Bench, progress: Watcher) -> "answer.Completeness":
    """The same of a record whose springs are at rest."""
    # Heavy imports: after what can be answered without them.
    from estimator.completeness.answer import Completeness, Outcome
    from estimator.completeness.closing import Limits, closing_scan
    from estimator.completeness.stretch import Stretch, stretches_of
    from estimator.trace.start import settling
    from hil.inputs.captured import control_of, drives_of, record_of
    from hil.inputs.declared import observer_settings_of, recorded_device_of

    if len(capture) < 2:
        return Completeness(Outcome.UNKNOWN, "not scanned: a single sample is too few", samples=len(capture))
    first, last = capture.ends
    begin_s, end_s = capture.ends_s
    device, stretches = recorded_device_of(bench, capture), []
    drives = drives_of(capture, device)
    settings = observer_settings_of(bench)
    for part in stretches_of(last - first + 1, settling(settings, device)):
        rows = capture.between(first + part.start, first + part.stop - 1)
        if len(rows) > 1:
            interval_s = rows.ends_s[0] - 1.0 / rows.tick_rate_Hz  # where that of the first row begins
            stretches.append(Stretch(record_of(rows, drives), interval_s, from_start=part.start == 0))
    found = closing_scan(
        stretches,
        device,
        settings,
        control_of(bench, capture),
        scored_s=(scored_from_s(begin_s, bench.loop.settle_s, capture.tick_rate_Hz), end_s),
        limits=Limits(bench.limits.angle_rad, bench.limits.innovation_ratio),
        declared=bench.device.calibration.by_symbol(bench.device.resonance_rad_s),
        progress=lambda stage, done, total: progress(Progress(stage, done, total)),
    )
    blamed = [(item.effect, item.coefficients) for item in (*found.lacks, *found.harmless)]
    return replace(found, reason="; ".join(filter(None, [found.reason, path_of(blamed, bench.device.mass_kg).told])))


def to_model(found: "answer.Completeness", began: float) -> Scan:
    """The answer for result.json; `began` is when the scan did, by time.perf_counter."""
    from estimator.completeness.answer import Outcome

    complete = {Outcome.COMPLETE: True, Outcome.LACKS: False, Outcome.UNKNOWN: None}[found.outcome]
    return Scan(
        complete=complete,
        reason=found.reason,
        lacks=tuple(map(_lacking, found.lacks)),
        harmless=tuple(map(_lacking, found.harmless)),
        cannot_exclude=() if found.information is None else _unexcluded(found.information),
        ratio=found.ratio if found.ratio is not None and np.isfinite(found.ratio) else None,
        samples=found.samples,
        span_s=found.seconds,
        seconds=round(time.perf_counter() - began, 3),
    )


def _lacking(item: "answer.Lacking") -> Lacking:
    return Lacking(
        effect=item.effect,
        coefficients={
            symbol: Parameter(value=c.value, ci95=(c.low, c.high), unit=c.unit)
            for symbol, c in item.coefficients.items()
        },
        angle_rad=item.angle.value,
        angle_ci95=(item.angle.low, item.angle.high),
        alike=item.alike,
    )


def _unexcluded(information: "Information") -> tuple[Unexcluded, ...]:
    rows = []
    for effect in information.effects:
        alone = information.posterior({}, with_effect=effect)
        angle = float(np.max(alone.angle_uncertainty))
        for k, symbol in enumerate(alone.symbols):
            figures = float(alone.deviation[k]), float(alone.sensitivity[-1, k]), angle
            if np.all(np.isfinite(figures)):
                rows.append(
                    Unexcluded(
                        effect=effect,
                        symbol=symbol,
                        unit=alone.units[k],
                        deviation=figures[0],
                        angle_rad_per_unit=figures[1],
                        angle_rad=angle,
                    )
                )
    return tuple(sorted(rows, key=lambda row: -row.angle_rad))
