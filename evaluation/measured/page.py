"""evaluation/results/measured.md, from the outcomes of a run."""

from collections.abc import Sequence
from pathlib import Path

from evaluation.measured.outcome import Outcome
from hil.records.atomic import write_text

_INTRODUCTION = """\
# Measured records

Real oscillators and gyros, measured by others, through the same model, observer and tracing as a record of the bench.
Every error is on a part of the record, or a second record, that no coefficient was fitted to and no effect was chosen
on; on the rate table it has a veto, a term that makes it worse is taken back. Made by `make measured`;
the records themselves stay with their owners. The time is that of a whole record, on the wall.
"""
_COLUMNS = ("record", "split", "error", "before", "after", "verdict", "what was missing", "time, s")


def write_page(path: Path, outcomes: Sequence[Outcome]) -> None:
    """Write the page at `path`."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = [_INTRODUCTION, "| " + " | ".join(_COLUMNS) + " |", "|" + "---|" * len(_COLUMNS)]
    rows = [(one.seconds, place, row) for one in outcomes for place, row in enumerate(one.rows)]
    for seconds, place, row in rows:
        taken = f"{seconds:.0f}" if place == 0 else ""
        error = f"{row.metric}, {row.unit}"
        effects = ", ".join(row.effects) or "–"
        cells = (row.record, row.split, error, f"{row.before:.4g}", f"{row.after:.4g}", row.verdict, effects, taken)
        lines.append("| " + " | ".join(cells) + " |")
    for outcome in outcomes:
        lines.append(f"\n## {outcome.title}")
        lines += [f"\n{paragraph}" for paragraph in outcome.paragraphs]
    write_text(path, "\n".join(lines) + "\n")
