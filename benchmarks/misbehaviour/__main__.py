"""`python -m benchmarks.misbehaviour [CASE …]`: run and judge cases of a board that misbehaves.

What has been judged is kept, and not run again until it is removed: a campaign can be interrupted.

    python -m benchmarks.misbehaviour                     all cases on a pty
    python -m benchmarks.misbehaviour --link vcan         those that mean something on CAN
    python -m benchmarks.misbehaviour safe_ignored --keep /tmp/one

Exit codes: 0 every case is as the pages promise, 1 some are not.
"""

import argparse
import sys
from pathlib import Path

from benchmarks.misbehaviour.campaign import ON_CAN, campaign, on_link
from benchmarks.misbehaviour.judging import cases
from benchmarks.virtual_can import NotHere


def main() -> int:
    """Run the command line; returns the exit code."""
    every = cases()
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.misbehaviour", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("case", nargs="*", help=f"one of the {len(every)} in expectations.toml; default all")
    parser.add_argument("--link", choices=("pty", "vcan", ON_CAN), default="pty", help="default pty")
    parser.add_argument("--jobs", type=int, default=2, help="cases, or machines with CAN, side by side; default 2")
    parser.add_argument("--keep", type=Path, help="folder of the outcomes; default runs/misbehaviour-LINK")
    options = parser.parse_args()
    if unknown := set(options.case) - set(every):
        parser.error(f"no case {', '.join(sorted(unknown))}; expectations.toml has them all")
    chosen = {name: case for name, case in every.items() if not options.case or name in options.case}
    folder = options.keep or Path("runs") / f"misbehaviour-{options.link.replace(':', '-')}"
    try:
        outcomes = campaign(chosen, options.link, folder, options.jobs, lambda said: print(said, flush=True))
    except NotHere as reason:
        parser.error(str(reason))
    left_out = [name for name in chosen if name not in on_link(chosen, options.link)]
    unmet = {name: outcome for name, outcome in outcomes.items() if outcome.told}
    for name, outcome in unmet.items():
        print(f"NOT MET {name}: {'; '.join(outcome.told)}")
        print("    " + "\n    ".join(outcome.said.strip().splitlines()[-6:]))
    if left_out:
        print(f"mean nothing on this link: {', '.join(left_out)}")
    print(f"{len(outcomes) - len(unmet)} of {len(outcomes)} met")
    return int(bool(unmet))


if __name__ == "__main__":
    sys.exit(main())
