"""How cost grows: a step with states and effects, score, report and trace with the length of the record.

Processor times and largest resident sets, each with the exponent of its least-squares line in logarithms.  Throughput
of campaigns against workers is in `python -m benchmarks campaigns`.

Step: blocks of 250 of the observer as the loop has it, all cases by turns, median of the rounds.  The others: a process
each, imports and loading of kernels included; so beside the exponent over all lengths stands that from the last but
one to the last, where what is fixed weighs least.
"""

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.memory import memory_MB
from benchmarks.row import Row, Say
from benchmarks.speed.cases import Case
from estimator.settings import Variant
from hil.bench import Bench, load_bench
from hil.bench.examples import find
from hil.bench.template import template, values_of
from hil.running.worker import Order, untold, work

ROUNDS, STEPS = 9, 5000
STATES = ((7, Variant.SENSE), (11, Variant.GYRO), (13, Variant.FULL))
EFFECTS = ("cubic_stiffness", "sense_gain", "quadratic_stiffness", "sense_cubic")
COUNTS = (0, 1, 2, 4)
LENGTHS = (200_000, 800_000, 3_200_000)
TRACED = (10_000, 40_000, 160_000)
REPORT = (
    "import sys; from pathlib import Path; from hil.report.page import write_report; "
    "write_report(*map(Path, sys.argv[1:]))"
)


class Cost(NamedTuple):
    """Of a process: seconds on a processor, largest resident set in MB."""

    seconds: float
    peak_MB: float


def exponent(x: Sequence[float], y: Sequence[float]) -> float:
    """Slope of log y over log x."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def rows(say: Say) -> list[Row]:
    """All of it."""
    figures = steps(say)
    with tempfile.TemporaryDirectory(prefix="growth-") as name:
        place = Path(name)
        figures += records(place, say)
        figures += traces(place, say)
    return figures


def steps(say: Say) -> list[Row]:
    """A step by states and by effects."""
    cases = {f"{states} states": Case(f"{states}", variant) for states, variant in STATES}
    cases |= {f"13 states, {n} effects": Case(f"13+{n}", Variant.FULL, EFFECTS[:n]) for n in COUNTS if n}
    runners = {name: case.runner(250) for name, case in cases.items()}
    times: dict[str, list[float]] = {name: [] for name in cases}
    for _ in range(ROUNDS):
        for name, run in runners.items():
            times[name].append(run(STEPS) / STEPS * 1e6)
    median = {name: statistics.median(found) for name, found in times.items()}
    say(", ".join(f"{name} {value:.3f} µs" for name, value in median.items()))
    plain = median["13 states"]
    found = [Row(f"step, {name}", value, "µs", "13 states", value / plain) for name, value in median.items()]
    slope = exponent([states for states, _ in STATES], [median[f"{states} states"] for states, _ in STATES])
    each = [(median[f"13 states, {n} effects"] - median["13 states, 1 effects"]) / (n - 1) for n in COUNTS if n > 1]
    return [
        *found,
        Row("step ~ states to the power of", slope, "1"),
        Row("step, each effect after the first", statistics.mean(each), "µs"),
    ]


def recorded(place: Path, name: str, samples: int) -> tuple[Path, Path]:
    """Folder and truth of a run of so many samples, without figures."""
    bench: Bench = load_bench(find("bench", name))
    seconds = samples / bench.device.sample_rate_Hz
    bench = bench.with_(loop={"clock": "lockstep", "duration_s": seconds, "settle_s": 0.2 * seconds})
    folder = place / f"{name}-{samples}"
    folder.mkdir()
    (folder / "bench.toml").write_text(template(values_of(bench), "The bench as run."), encoding="utf-8")
    truth = place / f"{name}-{samples}.arrow"
    link = f"inproc:{find('scenario', name)}"
    work(Order(bench.model_dump_json(), link, str(folder), truth=str(truth)), untold, own_process=False)
    return folder, truth


def cost_of(*arguments: str, cwd: Path) -> Cost:
    """Of Python with these arguments; RuntimeError where it fails.

    The largest resident set is VmHWM, looked at twenty times a second: that of rusage has what this process held when
    it made the other one.
    """
    peak = 0.0
    with (cwd / "said.txt").open("w+b") as said:
        process = subprocess.Popen(
            [sys.executable, *arguments], cwd=cwd, stdout=subprocess.DEVNULL, stderr=said,
            env=os.environ | {"GYROHIL_WORKERS": "1"},
        )  # fmt: skip
        while not (ended := os.wait4(process.pid, os.WNOHANG))[0]:
            if (now := memory_MB(process.pid)) is not None:
                peak = max(peak, now[1])
            time.sleep(0.05)
        _, status, usage = ended
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode not in (0, 1):
            said.seek(0)
            raise RuntimeError(said.read().decode(errors="replace")[-400:])
    return Cost(usage.ru_utime + usage.ru_stime, peak)


def records(place: Path, say: Say) -> list[Row]:
    """Score and report of records in gain mode, of growing length."""
    score, report = [], []
    for samples in LENGTHS:
        folder, truth = recorded(place, "s-modern", samples)
        score.append(cost_of("-m", "hil", "score", str(folder), "--truth", str(truth), cwd=place))
        report.append(cost_of("-c", REPORT, str(folder), str(truth), cwd=place))
        say(f"{samples} samples: score and report {score[-1]}, report {report[-1]}")
    return [*grown("score and report", LENGTHS, score), *grown("report", LENGTHS, report)]


def traces(place: Path, say: Say) -> list[Row]:
    """A trace of an undeclared effect, of growing length, the whole catalogue, one worker."""
    costs: list[Cost] = []
    for samples in TRACED:
        folder, _ = recorded(place, "s-undeclared", samples)
        verb = ("-m", "hil", "trace", str(folder), "--bench", str(folder / "bench.toml"), "--no-report")
        if not costs:
            cost_of(*verb, cwd=place)  # compiles what is not in the cache, once
        costs.append(cost_of(*verb, cwd=place))
        say(f"{samples} samples: trace {costs[-1]}")
    return grown("trace", TRACED, costs)


def grown(what: str, lengths: Sequence[int], costs: Sequence[Cost]) -> list[Row]:
    """Each cost, and the exponents: of all, and from the last but one to the last, where what is fixed weighs least."""
    seconds, peaks = [one.seconds for one in costs], [one.peak_MB for one in costs]
    found = []
    for length, one in zip(lengths, costs, strict=True):
        found += [
            Row(f"{what}, {length} samples", one.seconds, "s"),
            Row(f"{what}, {length} samples: memory", one.peak_MB, "MB"),
        ]
    each = (seconds[-1] - seconds[-2]) / (lengths[-1] - lengths[-2])
    return [
        *found,
        Row(f"{what}: time ~ length to the power of", exponent(lengths, seconds), "1"),
        Row(f"{what}: … from the last but one to the last", exponent(lengths[-2:], seconds[-2:]), "1"),
        Row(f"{what}: each sample, from the last but one to the last", 1e6 * each, "µs"),
        Row(f"{what}: memory ~ length to the power of", exponent(lengths, peaks), "1"),
    ]
