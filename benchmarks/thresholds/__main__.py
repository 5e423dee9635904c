"""`python -m benchmarks.thresholds`: see the package."""

import argparse
import datetime
import functools
import json
import math
import sys
from pathlib import Path

from benchmarks import thresholds as package
from benchmarks.thresholds.page import page
from benchmarks.thresholds.records import orders, tracers
from benchmarks.thresholds.screening import Asker, added, screen
from estimator.thresholds import THRESHOLDS, each
from hil.records.atomic import write_text


def main() -> int:
    """Run the command line; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.thresholds",
        description=package.__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("what", choices=["measure", "page"], nargs="?", default="measure")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default 2)")
    parser.add_argument("--folder", type=Path, default=Path("runs/thresholds"), help="of records and answers")
    parser.add_argument("--out", type=Path, default=Path("docs/results"), help="of thresholds.json and thresholds.md")
    parser.add_argument("--only", nargs="+", default=[""], help="only thresholds whose name contains one of these")
    parser.add_argument(
        "--add", action="store_true", help="put what is found of them into the table; else none is written"
    )
    parser.add_argument("--records", nargs="+", help="only these of the records")
    parser.add_argument("--minutes", type=float, default=math.inf, help="then what is left is told as open")
    options = parser.parse_args()
    kept = options.out / "thresholds.json"
    if options.what == "measure":
        from evaluation.undeclared.record import make

        records = options.records or list(tracers(options.folder))
        for record, (order, samples) in orders().items():
            if record in records or record == "clean":  # what is to be refused is made of that
                make(order, options.folder, samples)
        names = [one.name for one in each(THRESHOLDS) if any(part in one.name for part in options.only)]
        say = functools.partial(print, flush=True)
        found = screen(Asker(options.folder), names, records, options.jobs, say, options.minutes)
        if options.only != [""]:
            if not options.add:
                return 0
            found = added(json.loads(kept.read_text(encoding="utf-8")), found)
        found = {**found, "date": datetime.date.today().isoformat()}
        write_text(kept, json.dumps(found, indent=1, ensure_ascii=False) + "\n")
    write_text(options.out / "thresholds.md", page(json.loads(kept.read_text(encoding="utf-8"))))
    return 0


if __name__ == "__main__":
    sys.exit(main())
