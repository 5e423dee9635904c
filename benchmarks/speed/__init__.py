"""Speed of a step, each figure a ratio against a peer in the same run, with its spread.

The product's observer (`Observer.run` over a round's samples in one call, and a sample at a time; `Observer.tick` as
the loop calls it) beside the same step written by hand in plain C, filterpy's extended Kalman filter with the model in
NumPy, and the NumPy oracle.  The plain C is compiled twice: for this very processor, with products fused into sums, and
for the instruction set of the product's library without, as bits ask for that are the same on every machine.  All peers
run the same samples in turn, round after round; a figure is the median over the rounds, a ratio the median of the
rounds' ratios, and its spread their quartiles.  Times are the processor's, of this thread.
"""

import json
import os
import statistics
import subprocess
import sys
from collections.abc import Callable, Iterator

import numpy as np

from benchmarks.row import Row, Say
from benchmarks.speed.cases import CASES, Case
from benchmarks.speed.peers import SAME_ROUNDING, HandWritten, Oracle, filterpy_with_numpy
from estimator.core.compiler import command

ROUNDS = 11
FAST, SLOW = 5000, 40
"""Samples a round of what takes about a microsecond, and hundreds of them."""


def rows(say: Say) -> list[Row]:
    """Every case, in a process whose matrices are multiplied by one thread: several of them, for matrices of 13 rows,
    wait for one another most of the time, and the peers would look slower than they are.
    """
    one_thread = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    command = [sys.executable, "-m", "benchmarks.speed"]
    with subprocess.Popen(command, env=os.environ | one_thread, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None
        figures = []
        for line in child.stdout:
            told = json.loads(line)
            if "say" in told:
                say(told["say"])
            else:
                figures.append(Row(**told))
    if child.returncode:
        raise SystemExit(child.returncode)
    return figures


def measured(say: Say) -> list[Row]:
    """Every case in blocks and sample by sample, with the peers that can do it."""
    figures = []
    for case in CASES:
        figures += list(_measured(case))
        say(case.name)
    return figures


def _measured(case: Case) -> Iterator[Row]:
    ours = case.runner(FAST)
    peers: dict[str, Callable[[int], float]] = {}
    slow = {}
    if not case.effects and command():
        peers["C step"] = HandWritten(case).seconds
        peers["C step, same rounding"] = HandWritten(case, SAME_ROUNDING).seconds
    if case.against_slow:
        slow["filterpy with NumPy"] = filterpy_with_numpy(case)
        slow["NumPy"] = Oracle(case).seconds
    times: dict[str, list[float]] = {name: [] for name in ("block", "single", "tick", *peers, *slow)}
    single, tick = case.runner(1), case.ticker()
    for round_ in range(ROUNDS + 1):
        found = {
            "block": ours(FAST) / FAST,
            "single": single(FAST // 10) / (FAST // 10),
            "tick": tick(FAST // 5) / (FAST // 5),
        }
        found |= {name: seconds(FAST) / FAST for name, seconds in peers.items()}
        found |= {name: seconds(SLOW) / SLOW for name, seconds in slow.items()}
        if round_:  # the first warms up
            for name, value in found.items():
                times[name].append(value)
    yield from _rows(f"{case.name}, block of {FAST}", times["block"], {name: times[name] for name in (*peers, *slow)})
    per_sample = {"block": times["block"]}
    yield from _rows(f"{case.name}, single sample", times["single"], per_sample)
    yield from _rows(f"{case.name}, sample of a closed loop", times["tick"], per_sample)
    for name in (*peers, *slow):
        yield Row(f"{case.name}, {name}", 1e6 * statistics.median(times[name]), "µs")


def _rows(name: str, own: list[float], peers: dict[str, list[float]]) -> Iterator[Row]:
    value = 1e6 * statistics.median(own)
    if not peers:
        yield Row(name, value, "µs")
    for peer, theirs in peers.items():
        yield Row.over(name, value, "µs", peer, np.array(own) / np.array(theirs))
