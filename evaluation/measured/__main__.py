"""`python -m evaluation.measured [RECORD …]`: trace the measured records, into runs/measured.json and a page of docs.

The records are not part of the project; they lie in a folder beside it (--data, or GYROHIL_DATA), one folder each.
"""

import argparse
import json
import os
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

from evaluation.measured.outcome import Outcome, Say
from hil.records.atomic import write_text

RECORDS = ("silverbox", "emps", "magnetic_beam", "coupled_masses", "rate_table")


def measure_of(record: str) -> Callable[[Path, Path, Say], Outcome]:
    """What measures a record; imported when it is needed, since the kernels are."""
    from evaluation.measured import emps, free_decay, rate_table, silverbox

    own = {silverbox.FOLDER: silverbox.measure, emps.FOLDER: emps.measure, rate_table.FOLDER: rate_table.measure}
    return own.get(record) or partial(free_decay.measure, record)


def data_folder() -> Path:
    """Where the records are when nothing else is said."""
    return Path(os.environ.get("GYROHIL_DATA", "../shared/data"))


def main() -> int:
    """Measure what was asked for; 0 when every record was there."""
    parser = argparse.ArgumentParser(
        prog="python -m evaluation.measured",
        description=__doc__,
        epilog="example: python -m evaluation.measured emps rate_table --data ~/records",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("record", nargs="*", help=f"one of {', '.join(RECORDS)}; default all")
    parser.add_argument("--data", type=Path, default=data_folder(), help="folder of the records; default %(default)s")
    parser.add_argument("--out", type=Path, default=Path("runs/measured.json"), help="default %(default)s")
    parser.add_argument("--page", type=Path, default=Path("evaluation/results/measured.md"), help="default %(default)s")
    options = parser.parse_args()
    if unknown := set(options.record) - set(RECORDS):
        parser.error(f"no record {', '.join(sorted(unknown))}; known: {', '.join(RECORDS)}")
    if not options.data.is_dir():
        parser.error(f"{options.data}: no such folder; say where the records are with --data or GYROHIL_DATA")
    outcomes, absent = [], []
    for name in options.record or RECORDS:
        if not (options.data / name).is_dir():
            print(f"{name}: skipped, {options.data / name} is not there", file=sys.stderr)
            absent.append(name)
            continue
        begin = time.monotonic()
        with tempfile.TemporaryDirectory(prefix="gyrohil-") as work:
            outcome = measure_of(name)(options.data / name, Path(work), lambda line: print(line, file=sys.stderr))
        for row in outcome.rows:
            what = ", ".join(row.effects) or "nothing to add"
            print(f"{row.record:<15} {row.split:<24} {row.before:>10.4g} → {row.after:<10.4g} {row.unit:<10} "
                  f"{row.verdict}: {what}", flush=True)  # fmt: skip
        outcome = replace(outcome, seconds=time.monotonic() - begin)
        print(f"{name}: {outcome.seconds:.0f} s", file=sys.stderr)
        outcomes.append(outcome)
    keep(options.out, outcomes)
    if set(options.record or RECORDS) == set(RECORDS) and not absent:
        from evaluation.measured.page import write_page

        write_page(options.page, outcomes)
    else:
        print(f"{options.page}: left as it is, it shows all records together", file=sys.stderr)
    return 1 if absent else 0


def keep(path: Path, outcomes: list[Outcome]) -> None:
    """Replace the rows of these records in the file."""
    rows = [row._asdict() for outcome in outcomes for row in outcome.rows]
    measured = {row["record"] for row in rows}
    old = json.loads(path.read_text()) if path.exists() else []
    kept = [row for row in old if row["record"] not in measured]
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, json.dumps(kept + rows, indent=1, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    sys.exit(main())
