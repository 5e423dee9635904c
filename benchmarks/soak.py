"""Ten million samples of S-slow, 42 minutes of its time: in-process lockstep, the codecs in the path, nothing recorded.

The loop is the product's own; in place of record files there are tracks that sum up everything they are given, so
that one value that is not finite, anywhere, shows at the end.  Every 10⁵ samples both covariances of the observer are
checked to be positive definite (smallest eigenvalue of their correlation matrices).  Energy is that of the true motion,
from the emulator, beside ½ k A², from 20 s on, at every sample.  The dither is half of the example's: the energy that
it shakes in and out is 0.34 % rms at 0.3 m/s², which in so many samples exceeds 1 % now and then.
"""

import math
import resource
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.lockstep import Floats, bench_of, scenario_of
from benchmarks.row import Row, Say
from device_emulator.board import Board
from device_emulator.device import TRUTH_COLUMNS, Device
from estimator.observer import Observer
from hil.bench import Bench, override
from hil.inputs.declared import controller_settings_of, device_of, observer_settings_of
from hil.running.force import ForceLoop
from hil.running.preflight import configure
from hil.running.skeleton import Setup
from hil.wire import client
from hil.wire.endpoint import Endpoint
from hil.wire.inproc import InprocLink
from hil.wire.messages import ClockMode, SafeReason

SAMPLES = 10_000_000
CHECK_EVERY = 100_000
SETTLE_S = 20.0
DITHER = 0.15
SEED = 1


class Sum:
    """Takes the place of a record file: the sum over all its rows and columns."""

    dropped = 0

    def __init__(self) -> None:
        self.total = 0.0

    def put(self, *values: float) -> bool:
        """Take one row."""
        self.total += sum(values)
        return True

    def push(self, rows: NDArray[np.void]) -> int:
        """Take rows."""
        for row in rows:
            self.put(*row)
        return len(rows)


class Witness:
    """What the emulator says was true: the deviation of the energy from its target, its largest and its squares."""

    def __init__(self, bench: Bench) -> None:
        self._stiffness = bench.target_stiffness_per_s2
        self._energy = 0.5 * self._stiffness * bench.device.amplitude_m**2
        self._from = round(SETTLE_S * bench.device.sample_rate_Hz)
        self.worst = 0.0
        self.squares = 0.0
        self.samples = 0

    def __call__(self, first_tick: int, rows: Floats) -> None:
        x, vx, y, vy = (rows[:, TRUTH_COLUMNS.index(name)] for name in ("x_m", "vx_mps", "y_m", "vy_mps"))
        if first_tick >= self._from:
            deviation = 0.5 * (vx**2 + vy**2 + self._stiffness * (x**2 + y**2)) / self._energy - 1.0
            self.worst = max(self.worst, float(np.abs(deviation).max()))
            self.squares += float(deviation @ deviation)
            self.samples += len(deviation)


def smallest_eigenvalue(covariance: Floats) -> float:
    """Of the correlation matrix, so that units do not matter; NaN where the covariance is not finite."""
    deviation = np.sqrt(np.diagonal(covariance))
    correlation = covariance / np.outer(deviation, deviation)
    return float(np.linalg.eigvalsh(correlation)[0]) if np.isfinite(correlation).all() else math.nan


def resident_MB() -> float:
    """Memory of this process at the moment."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 1e6


def rows(say: Say) -> list[Row]:
    """One long run."""
    bench = override(bench_of("s-slow", controller={"dither_mps2": DITHER}), {"loop": {"clock": "lockstep"}}, "soak")
    scenario = scenario_of("s-slow")
    witness = Witness(bench)
    endpoint = Endpoint(InprocLink(Board(scenario, Device(scenario, SEED, witness), (ClockMode.LOCKSTEP,))))
    identity = client.connect(endpoint)
    observer = Observer(device_of(bench), observer_settings_of(bench), controller_settings_of(bench, identity))
    registers = configure(endpoint, identity, bench)
    tracks = {stem: Sum() for stem in ("capture", "innovation", "timing", "estimates", "covariance")}
    loop = ForceLoop(Setup(endpoint, identity, bench, observer, tracks, registers))
    loop.arm()
    eigenvalues: list[float] = []
    memory: list[float] = []
    begin = time.monotonic()

    def check(done: int) -> None:
        eigenvalues.append(min(smallest_eigenvalue(matrix) for matrix in observer.covariances))
        memory.append(resident_MB())
        if len(eigenvalues) % 10 == 0:
            say(f"{done / 1e6:.0f} million samples, {time.monotonic() - begin:.0f} s, {memory[-1]:.0f} MB")

    loop.run(SAMPLES, check, CHECK_EVERY)
    elapsed = time.monotonic() - begin
    loop.finish(SafeReason.HOST_REQUEST)
    endpoint.close()
    middle = len(memory) // 2
    return [
        Row("samples", loop.counters.samples, "1"),
        Row(
            "record files with a value that is not finite",
            sum(not math.isfinite(t.total) for t in tracks.values()),
            "1",
        ),
        Row("smallest eigenvalue of the correlation matrices", min(eigenvalues), "1"),
        Row("energy, largest deviation", 100.0 * witness.worst, "%"),
        Row("energy, rms deviation", 100.0 * math.sqrt(witness.squares / witness.samples), "%"),
        Row("memory after the first 1e5 samples", memory[0], "MB"),
        Row("memory grown since, in the middle", memory[middle] - memory[0], "MB"),
        Row("memory grown since, at the end", memory[-1] - memory[0], "MB"),
        Row("time per sample, board and codecs included", elapsed / SAMPLES * 1e6, "µs"),
        Row("bench time over wall time", SAMPLES / scenario.board.sample_rate_Hz / elapsed, "1"),
    ]
