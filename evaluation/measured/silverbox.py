"""Silverbox: free-run simulation error by the convention of nonlinearbenchmark.org."""

from pathlib import Path

from evaluation.measured.oscillator import described, errors_on, imported, judged, record_of, traced
from evaluation.measured.outcome import MeasuredRow, Outcome, Say, rms

FOLDER = "silverbox"
_FIRST = 50  # outputs of a test that may set the state and are not scored
_TESTS = ("multisine", "arrow", "arrow_no_extrapolation")


def measure(data: Path, work: Path, say: Say) -> Outcome:
    """Trace the training part, score the three tests."""
    capture = imported(data / "SNLS80mV.csv.gz", work, "silverbox")
    record = record_of(capture)
    train = record.part(slice(*capture.segments["train"]))
    trace = traced(train, "silverbox", say)
    rows, against = [], []
    for test in _TESTS:
        part = record.part(slice(*capture.segments[test]))
        before, after = (error[_FIRST:] for error in errors_on(part, "silverbox", trace))
        verdict, reasons = judged("silverbox", trace, part)
        against += [f"- {test}: {reason}" for reason in reasons]
        errors = (1e3 * rms(before), 1e3 * rms(after))
        rows.append(MeasuredRow(FOLDER, test, "free-run RMSE", "mV", *errors, verdict, trace.named))
    words = (
        "Fitted to rows 40,650 to 105,712; the first 50 outputs of each test set the state and are not scored; the "
        "drive is taken as band-limited between its samples. Best published on the three tests (black boxes): 0.289, "
        "0.334 and 0.257 mV. The tests were used for nothing but the score."
    )
    return Outcome("Silverbox", rows, [words, *described(trace), *(["\n".join(against)] if against else [])])
