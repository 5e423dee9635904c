"""10⁹ samples of gain mode in lockstep, nearly three hours of S-modern's time at 5 kHz: one unbroken run, gone on with
after any kill.

The loop is the product's own, board, codecs and observer in one process; in place of record files there are tracks that
hash every byte they are given.  Every 10⁷ samples there is a mark: the hash of all bytes so far, whether both
covariances are symmetric to the last bit and positive definite (smallest eigenvalue of their correlation matrices), the
true energy beside ½ k A² over the stretch, from the emulator, and the memory of the process.  With the mark goes a
snapshot of everything, board and loop, from which the next call goes on: a run that was killed ends in the same hashes
as one that was not.  The dither is a sixteenth of the example's: it shakes
energy in and out, 0.1 % rms at 0.125 m/s² and in proportion.

ENDURANCE names the folder (`runs/endurance`), ENDURANCE_SAMPLES another length, both in the environment.
"""

import hashlib
import json
import math
import os
import pickle
import resource
import struct
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.lockstep import Floats, bench_of, scenario_of
from benchmarks.row import Row, Say
from device_emulator.board import Board
from device_emulator.device import TRUTH_COLUMNS, Device
from estimator.observer import Observer
from hil.bench import Bench, override
from hil.inputs.declared import controller_settings_of, device_of, observer_settings_of
from hil.running.loop.skeleton import Loop
from hil.running.process.worker import make_loop
from hil.running.safety.preflight import configure
from hil.wire import client
from hil.wire.endpoint import Endpoint
from hil.wire.inproc import InprocLink
from hil.wire.messages import ClockMode

EXAMPLE = "s-modern-5k"
SAMPLES = 1_000_000_000
MARK = 10_000_000
EVERY = 500
DITHER = 0.125
SETTLE_S = 2.0
SEED = 17
HASHED = ("capture", "innovation", "estimates", "covariance")
MARKS, SNAPSHOT = "marks.jsonl", "snapshot.pickle"


class Chain:
    """Takes the place of a record file: a hash of all its rows, each stretch's with that of the one before."""

    dropped = 0

    def __init__(self) -> None:
        self.digest = b""
        self._stretch = bytearray()

    def put(self, *values: float) -> bool:
        """Take one row."""
        self._stretch += struct.pack(f"<{len(values)}d", *values)
        self._shorten()
        return True

    def push(self, rows: NDArray[np.void]) -> int:
        """Take rows."""
        self._stretch += rows.tobytes()
        self._shorten()
        return len(rows)

    def _shorten(self, least: int = 1 << 16) -> None:
        """Each so many bytes a link of the chain: a running hash could not be kept in a snapshot."""
        if len(self._stretch) >= least:
            self.digest = hashlib.blake2b(self.digest + self._stretch, digest_size=16).digest()
            self._stretch.clear()

    def mark(self) -> str:
        """The hash of everything so far."""
        self._shorten(1)
        return self.digest.hex()


class Silent:
    """A track that keeps nothing: wall times differ from run to run."""

    dropped = 0

    def put(self, *_: float) -> bool:
        """Take one row."""
        return True

    def push(self, rows: NDArray[np.void]) -> int:
        """Take rows."""
        return len(rows)


class Energy:
    """What the emulator says was true: the energy beside its target, over the stretch since the last mark."""

    def __init__(self, bench: Bench) -> None:
        self._stiffness = bench.target_stiffness_per_s2
        self._target = 0.5 * self._stiffness * bench.device.amplitude_m**2
        self._from = round(SETTLE_S * bench.device.sample_rate_Hz)
        self.clear()

    def clear(self) -> None:
        """A new stretch."""
        self.worst = self.sum = self.squares = 0.0
        self.samples = 0

    def __call__(self, first_tick: int, rows: Floats) -> None:
        if first_tick < self._from:
            return
        x, vx, y, vy = (rows[:, TRUTH_COLUMNS.index(name)] for name in ("x_m", "vx_mps", "y_m", "vy_mps"))
        deviation = 0.5 * (vx * vx + vy * vy + self._stiffness * (x * x + y * y)) / self._target - 1.0
        self.worst = max(self.worst, float(np.abs(deviation).max()))
        self.sum += float(deviation.sum())
        self.squares += float(deviation @ deviation)
        self.samples += len(deviation)


class Mark(NamedTuple):
    """What is known at the end of a stretch; `seconds` of processor time over it."""

    samples: int
    hash: str
    smallest_eigenvalue: float
    asymmetry: float
    energy_mean: float
    energy_rms: float
    energy_worst: float
    lost: int
    resident_MB: float
    seconds: float
    finished: str


class Run:
    """Everything there is of one run: it can be pickled at a mark and gone on with."""

    def __init__(self) -> None:
        scenario = scenario_of(EXAMPLE)
        bench = override(
            bench_of(EXAMPLE, controller={"dither_mps2": DITHER}),
            {"loop": {"clock": "lockstep", "estimate_every": EVERY}},
            "endurance",
        )
        self.energy = Energy(bench)
        endpoint = Endpoint(InprocLink(Board(scenario, Device(scenario, SEED, self.energy), (ClockMode.LOCKSTEP,))))
        identity = client.connect(endpoint)
        self.observer = Observer(device_of(bench), observer_settings_of(bench), controller_settings_of(bench, identity))
        registers = configure(endpoint, identity, bench)
        self.tracks = {stem: Chain() for stem in HASHED}
        self.loop: Loop = make_loop(
            endpoint, identity, bench, self.observer, {**self.tracks, "timing": Silent()}, registers
        )
        self.loop.arm()
        self.samples = 0

    def stretch(self, samples: int) -> Mark:
        """Run until there are so many samples in all."""
        self.energy.clear()
        begun = time.process_time()
        go = self.loop.run if self.samples == 0 else self.loop.go_on
        go(samples, lambda _: None, EVERY * 100)
        if self.loop.stop:
            raise SystemExit(f"endurance: the loop stopped between {self.samples} and {samples} samples")
        self.samples = samples
        found = [soundness(matrix) for matrix in self.observer.covariances]
        chained = "".join(self.tracks[stem].mark() for stem in HASHED)
        energy, n = self.energy, max(self.energy.samples, 1)
        return Mark(
            samples=samples,
            hash=hashlib.blake2b(chained.encode(), digest_size=16).hexdigest(),
            smallest_eigenvalue=min(eigenvalue for eigenvalue, _ in found),
            asymmetry=max(asymmetry for _, asymmetry in found),
            energy_mean=energy.sum / n,
            energy_rms=math.sqrt(energy.squares / n),
            energy_worst=energy.worst,
            lost=self.loop.counters.lost,
            resident_MB=resident_MB(),
            seconds=time.process_time() - begun,
            finished=time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        )


def soundness(covariance: Floats) -> tuple[float, float]:
    """Smallest eigenvalue of the correlation matrix, so that units do not matter, NaN where it is not finite; largest
    difference of an entry and its mirror.
    """
    deviation = np.sqrt(np.diagonal(covariance))
    correlation = covariance / np.outer(deviation, deviation)
    if not np.isfinite(correlation).all():
        return math.nan, math.nan
    return float(np.linalg.eigvalsh(correlation)[0]), float(np.max(np.abs(covariance - covariance.T)))


def resident_MB() -> float:
    """Memory of this process at the moment."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 1e6


def endure(folder: Path, samples: int, mark: int, say: Say) -> list[Mark]:
    """Go on from the folder's snapshot, or begin, until there are so many samples; all marks."""
    folder.mkdir(parents=True, exist_ok=True)
    run, marks = restored(folder) or (Run(), [])
    if marks:
        say(f"going on from {marks[-1].samples:,} samples in {folder}")
    while run.samples < samples:
        marks.append(run.stretch(min(run.samples + mark, samples)))
        keep(folder, run, marks)
        last = marks[-1]
        say(
            f"{last.samples / 1e6:.0f} million samples, {last.hash}, eigenvalue {last.smallest_eigenvalue:.2e}, energy "
            f"{100 * last.energy_rms:.3f} % rms, {last.resident_MB:.0f} MB, {1e6 * last.seconds / mark:.2f} µs a sample"
        )
    return marks


def keep(folder: Path, run: Run, marks: list[Mark]) -> None:
    """The snapshot with its marks in one file, so that a kill leaves both or neither; the marks again, to be read."""
    scratch = folder / f"{SNAPSHOT}.tmp"
    with scratch.open("wb") as file:
        pickle.dump((run, marks), file)
        file.flush()
        os.fsync(file.fileno())
    scratch.replace(folder / SNAPSHOT)
    (folder / MARKS).write_text("".join(json.dumps(mark._asdict()) + "\n" for mark in marks))


def restored(folder: Path) -> tuple[Run, list[Mark]] | None:
    """Run and marks of the snapshot, None where there is none."""
    path = folder / SNAPSHOT
    if not path.exists():
        return None
    with path.open("rb") as file:  # written by this program, in its own folder
        found: Any = pickle.load(file)
    run, marks = found
    return run, marks


def rows(say: Say) -> list[Row]:
    """The run as far as it is wanted."""
    folder = Path(os.environ.get("ENDURANCE", "runs/endurance"))
    samples = int(float(os.environ.get("ENDURANCE_SAMPLES", SAMPLES)))
    marks = endure(folder, samples, MARK, say)
    settled = marks[1:] or marks
    after = marks[min(1, len(marks) - 1)]
    return [
        Row("samples", marks[-1].samples, "1"),
        Row("samples lost", marks[-1].lost, "1"),
        Row("smallest eigenvalue of the correlation matrices", min(m.smallest_eigenvalue for m in marks), "1"),
        Row("largest asymmetry of a covariance", max(m.asymmetry for m in marks), "1"),
        Row("energy, largest deviation of a sample", 100.0 * max(m.energy_worst for m in settled), "%"),
        Row("energy, largest rms deviation of a stretch", 100.0 * max(m.energy_rms for m in settled), "%"),
        Row("energy, largest mean deviation of a stretch", 100.0 * max(abs(m.energy_mean) for m in settled), "%"),
        Row("memory grown after the second mark", marks[-1].resident_MB - after.resident_MB, "MB"),
        Row("processor time per sample", 1e6 * sum(m.seconds for m in marks) / marks[-1].samples, "µs"),
    ]
