"""The process that runs of a campaign are carried out in: tasks in, rows out, a line of JSON each.

Started by `hil.sweeping.process` as `python -m hil.sweeping.child`.  It ends when nobody has tasks for it any more, and
within a second when the process that started it is gone.  A fault of the program ends it; its last line says which.
"""

import json
import os
import sys
import threading
import time
from dataclasses import asdict
from types import TracebackType
from typing import Any

from hil.errors.ending import ExitCode


def main() -> int:
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # whatever else is printed is none of the answers

    def answer(**said: Any) -> None:
        answers.write(json.dumps(said) + "\n")
        answers.flush()

    def fault(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
        sys.__excepthook__(kind, error, trace)
        answer(died=line_of(error))
        sys.stderr.flush()
        os._exit(ExitCode.FAULT)

    sys.excepthook = fault
    from estimator.side_by_side import one_worker_each
    from hil.errors.ending import line_of
    from hil.sweeping.one_run import carry_out
    from hil.sweeping.tasks import Task

    one_worker_each()
    for line in sys.stdin:
        try:
            answer(done=asdict(carry_out(Task.from_json(line))))
        except (OSError, MemoryError) as error:  # of this machine: another run would fare no better
            answer(machine=line_of(error))
    return ExitCode.GOOD


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(ExitCode.INTERRUPTED)


if __name__ == "__main__":
    sys.exit(main())
