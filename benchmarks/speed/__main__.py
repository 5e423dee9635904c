"""The figures as JSON lines, for `benchmarks.speed.rows`, which sees to the threads."""

import json

from benchmarks.speed import measured

if __name__ == "__main__":
    for row in measured(lambda line: print(json.dumps({"say": line}), flush=True)):
        print(json.dumps(row._asdict()), flush=True)
