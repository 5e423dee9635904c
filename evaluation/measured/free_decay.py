"""Free responses: a magnetic beam that rings down, two coupled masses on an air track."""

from pathlib import Path

import numpy as np

from evaluation.measured.oscillator import confirmed, declared, described, errors_on, imported, record_of, traced
from evaluation.measured.outcome import MeasuredRow, Outcome, Say, rms

_RECORDS = {
    "magnetic_beam": ("decay.csv.gz", "magnetic-beam", False, "Magnetic beam, free decay", 1e6, "µstrain"),
    "coupled_masses": ("track.csv", "coupled-masses", True, "Coupled masses", 1.0, "motion-capture units"),
}


def measure(folder: str, data: Path, work: Path, say: Say) -> Outcome:
    """Trace the first part; the same free run, never corrected, is scored on the rest."""
    file, name, nonuniform, title, factor, unit = _RECORDS[folder]
    capture = imported(data / file, work, name, nonuniform=nonuniform)
    record = record_of(capture)
    first, last = capture.segments["train"], capture.segments["test"]
    trace, verdict, against = confirmed(name, traced(record.part(slice(*first)), name, say), record)
    device, _ = declared(name)
    errors = errors_on(record, name, trace, fitted=True)
    before, after = (rms(error[slice(*last)]) for error in errors)
    effects = trace.named
    rows = [MeasuredRow(folder, "test", "free-run RMSE", unit, factor * before, factor * after, verdict, effects)]
    signal = record.sense[slice(*last)] - np.mean(record.sense[slice(*last)], axis=0)
    share = 100.0 / rms(signal)
    metric = "free-run RMSE of the signal"
    rows.append(MeasuredRow(folder, "test", metric, "%", share * before, share * after, verdict, effects))
    fitted = [factor * rms(error[slice(*first)]) for error in errors]
    words = (
        f"Over the fitted part the free run errs by {fitted[0]:.3g} {unit} before and {fitted[1]:.3g} after; the noise "
        f"is taken as {factor * device.noise[0]:.3g}. The test part goes on from the same start."
    )
    reasons = ["\n".join(f"- {reason}" for reason in against)] if against else []
    return Outcome(title, rows, [words, *described(trace), *reasons])
