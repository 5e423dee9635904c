"""One process: thresholds that are not as they are, and what tracing answers by them.

Each line of input is {"changes": …, "records": […]}; each line of output the answers to one, by record.  The changes of
the first line are made before tracing is imported.  Those of the others are made in place, which a number that is
read on import does not notice: `early` in an answer to a line with "watch" says which these are.
"""

import importlib
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.thresholds.change import in_place, install, watch


def main() -> None:
    """Answer until the input ends; the folder of the records is the only argument."""
    folder = Path(sys.argv[1])
    asked = json.loads(sys.stdin.readline())
    install(asked["changes"])
    seen: set[str] = set()
    if asked.get("watch"):
        watch(seen)
    from benchmarks.thresholds.records import tracers

    known = tracers(folder)
    for module in ("estimator.trace.tracing", "estimator.rate_sensor.trace"):
        importlib.import_module(module)
    early = sorted(seen)
    while True:
        answers = {}
        for name in asked["records"]:
            seen.clear()
            answers[name] = _answer(known[name])
            if asked.get("watch"):
                answers[name] |= {"read": sorted({*seen, *early}), "early": early}
        print(json.dumps(answers), flush=True)
        line = sys.stdin.readline()
        if not line:
            return
        asked = json.loads(line)
        in_place(asked["changes"])


def _answer(tracer: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    begin = time.process_time()
    try:
        answer = tracer()
    except (ArithmeticError, AssertionError, AttributeError, LookupError, TypeError, ValueError) as error:
        answer = {"verdict": f"fails: {type(error).__name__}", "words": []}
    return answer | {"seconds": round(time.process_time() - begin, 2)}


if __name__ == "__main__":
    main()
