"""Speed of a step, each figure a ratio against a peer in the same run, with its spread.

The product's observer (`Observer.run` in blocks of 250, and a sample at a time; `Observer.tick` as the loop calls it)
beside a step written by hand in C (built here with -O3 -march=native, where a compiler is), filterpy's extended Kalman
filter with the compiled flow as its model and with the model in NumPy, and the NumPy oracle.  All peers run the same
samples in turn, round after round; a figure is the median over the rounds, a ratio the median of the rounds' ratios,
and its spread their quartiles.  Times are the processor's, of this thread.  The C step must give the same angle, state
and deviations, or it is no peer.
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
from benchmarks.speed.peers import Filterpy, HandWritten, Oracle, filterpy_with_numpy

ROUNDS = 11
FAST, FEW, SLOW = 5000, 500, 40
"""Samples a round of what takes about a microsecond, tens, and hundreds of them."""
ALIKE = 1e-6
"""Of an angle in rad, of states in their standard deviations: what rounding leaves after 2000 samples is 1e-7."""
BLOCK = 250

Timed = Callable[[], float]
"""Seconds for a round of its samples."""


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
        figures += list(_measured(case, say))
        say(case.name)
    return figures


def _measured(case: Case, say: Say) -> Iterator[Row]:
    ours = case.runner(BLOCK)
    peers: dict[str, Callable[[int], float]] = {}
    if (hand := HandWritten.built(case)) is not None:
        apart = hand.apart(case)
        if not apart < ALIKE:
            raise AssertionError(f"{case.name}: the C step differs by {apart:.2g}; it is no peer")
        peers["C step"] = hand.seconds
    else:
        say("no C compiler here: the C step is left out")
    if case.against_slow:
        peers["filterpy with our kernel"] = Filterpy(case).seconds
        peers["filterpy with NumPy"] = filterpy_with_numpy(case)
        peers["NumPy"] = Oracle(case).seconds
    samples = {name: FAST if name == "C step" else SLOW for name in peers}
    times: dict[str, list[float]] = {name: [] for name in ("block", "single", "tick", *peers)}
    single, tick = case.runner(1), case.ticker()
    for round_ in range(ROUNDS + 1):
        found = {
            "block": ours(FAST) / FAST,
            "single": single(FAST // 10) / (FAST // 10),
            "tick": tick(FAST // 5) / (FAST // 5),
        }
        found |= {name: seconds(samples[name]) / samples[name] for name, seconds in peers.items()}
        if round_:  # the first warms up
            for name, value in found.items():
                times[name].append(value)
    yield from _rows(f"{case.name}, block of {BLOCK}", times["block"], {name: times[name] for name in peers})
    per_sample = {"block": times["block"]}
    yield from _rows(f"{case.name}, single sample", times["single"], per_sample)
    yield from _rows(f"{case.name}, sample of a closed loop", times["tick"], per_sample)
    for name in peers:
        yield Row(f"{case.name}, {name}", 1e6 * statistics.median(times[name]), "µs")


def _rows(name: str, own: list[float], peers: dict[str, list[float]]) -> Iterator[Row]:
    value = 1e6 * statistics.median(own)
    if not peers:
        yield Row(name, value, "µs")
    for peer, theirs in peers.items():
        yield Row.over(name, value, "µs", peer, np.array(own) / np.array(theirs))
