"""`python -m tests.tour [FOLDER]`: every command of the README and of the tutorial, twice in a row in one folder.

Prints each with its exit code and seconds; exit code 1 when one did not leave as documented.
"""

import sys
import tempfile
from pathlib import Path

from tests.tour.commands import PAGES, available, commands, run

TIMES = 2


def main() -> int:
    """Run them all."""
    wrong = 0
    with tempfile.TemporaryDirectory() as scratch:
        place = Path(sys.argv[1] if len(sys.argv) > 1 else scratch)
        for time in range(TIMES):
            for page in PAGES:
                for command in commands(page):
                    if not available(command):
                        print(f"{time + 1}  –       –  {command}  (its record is not here)", flush=True)
                        continue
                    done = run(command, place)
                    wrong += not done.as_documented
                    mark = "" if done.as_documented else "  NOT AS DOCUMENTED"
                    print(f"{time + 1}  {done.code}  {done.seconds:6.1f} s  {command}{mark}", flush=True)
                    if mark:
                        print(done.output[-2000:], flush=True)
    print(f"{wrong} not as documented" if wrong else "all as documented")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
