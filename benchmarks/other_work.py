"""`python -m benchmarks.other_work SHARE`: work that knows nothing of the bench, until its input ends.

That share of one core, in bursts as often as a page is drawn: what a loop loses beside it, it loses to
the machine.
"""

import sys
import threading
import time

PERIOD_S = 0.02


def main() -> None:
    """That share of one core."""
    share = min(float(sys.argv[1]), 1.0)
    ended = threading.Event()

    def wait_for_the_end() -> None:
        sys.stdin.read()
        ended.set()

    threading.Thread(target=wait_for_the_end, daemon=True).start()
    while not ended.is_set():
        until = time.perf_counter() + share * PERIOD_S
        while time.perf_counter() < until:
            pass
        time.sleep((1.0 - share) * PERIOD_S)


if __name__ == "__main__":
    main()
