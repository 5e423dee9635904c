"""A hundred million samples in lockstep on a bad line, twice: the same bytes, and every harmed frame in the books.

Gain mode of S-modern at 5 kHz (10⁸ samples, 17 minutes of its time) and force mode of S-slow (10⁷, 42 minutes).  The
loop is the product's own; in place of record files there are tracks that hash every byte they are given.  Each pair of
runs is two processes at the same time.  Frames are lost, damaged and repeated by the scenario's seed; what the line did
stands beside what host and board counted, and samples and gaps add up to the ticks that passed.
"""

import hashlib
import resource
import struct
import time
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.lockstep import bench_of, scenario_of
from benchmarks.row import Row, Say
from device_emulator.board import Board
from device_emulator.device import Device
from device_emulator.line import Line
from estimator.observer import Observer
from hil.bench import override
from hil.inputs.declared import controller_settings_of, device_of, observer_settings_of
from hil.running.preflight import configure
from hil.running.worker import make_loop
from hil.wire import client
from hil.wire.endpoint import Endpoint
from hil.wire.inproc import InprocLink
from hil.wire.messages import ClockMode, SafeReason

LINE = {"lost": 1e-3, "corrupted": 1e-4, "duplicated": 1e-3}
SEED = 9
CHECKS = 100
_PENDING = 1 << 16  # bytes that are hashed at once


class Long(NamedTuple):
    """One of the two modes: example, samples, rows between two recorded estimates."""

    example: str
    samples: int
    every: int


LONG = {"gain": Long("s-modern-5k", 100_000_000, 500), "force": Long("s-slow", 10_000_000, 40)}


class Digest:
    """Takes the place of a record file: a running hash of all its rows."""

    dropped = 0

    def __init__(self) -> None:
        self._hash = hashlib.blake2b(digest_size=16)
        self._waiting = bytearray()

    def put(self, *values: float) -> bool:
        """Take one row."""
        self._waiting += struct.pack(f"<{len(values)}d", *values)
        if len(self._waiting) >= _PENDING:
            self._flush()
        return True

    def push(self, rows: NDArray[np.void]) -> int:
        """Take rows."""
        self._flush()
        self._hash.update(rows.tobytes())
        return len(rows)

    @property
    def hex(self) -> str:
        """Of everything so far."""
        self._flush()
        return self._hash.hexdigest()

    def _flush(self) -> None:
        self._hash.update(self._waiting)
        self._waiting.clear()


class _OnLine:
    """A board behind the line of its scenario."""

    def __init__(self, board: Board, line: Line) -> None:
        self.exchange, self.close = line.exchange, board.close


class Outcome(NamedTuple):
    """What one process found."""

    digests: dict[str, str]
    samples: int
    lost: int
    ticks: int
    block: int  # ticks that the board may have gone on by when the host stopped
    inflicted: dict[str, int]
    frames: dict[str, int]
    board_lost: int
    finite: bool
    grown_MB: float
    seconds: float


def endure(mode: str, samples: int) -> Outcome:
    """One run of `samples` samples."""
    long = LONG[mode]
    scenario = scenario_of(long.example, faults=dict(LINE))
    bench = override(bench_of(long.example), {"loop": {"clock": "lockstep", "estimate_every": long.every}}, mode)
    board = Board(scenario, Device(scenario, SEED), (ClockMode.LOCKSTEP,))
    line = Line(board, scenario, SEED)
    endpoint = Endpoint(InprocLink(_OnLine(board, line)))
    identity = client.connect(endpoint)
    observer = Observer(device_of(bench), observer_settings_of(bench), controller_settings_of(bench, identity))
    configure(endpoint, identity, bench)
    tracks = {stem: Digest() for stem in ("capture", "innovation", "timing", "estimates", "covariance")}
    del tracks["timing"]  # wall times differ from run to run
    loop = make_loop(endpoint, identity, bench, observer, {**tracks, "timing": _Nothing()})
    loop.arm()
    memory: list[int] = []
    begin = time.monotonic()
    loop.run(samples, lambda _: memory.append(_resident_kB()), samples // CHECKS)
    seconds = time.monotonic() - begin
    loop.finish(SafeReason.HOST_REQUEST)
    endpoint.close()
    counters = loop.counters
    return Outcome(
        digests={stem: track.hex for stem, track in tracks.items()},
        samples=counters.samples,
        lost=counters.lost,
        ticks=board.tick + 1,
        block=bench.loop.block if bench.loop.mode == "gain" else 1,
        inflicted=dict(line.inflicted),
        frames={"lost": endpoint.rx.lost, "repeated": endpoint.rx.repeated, "damaged": endpoint.rx.bad},
        board_lost=counters.board.get("lost_seq", -1),
        finite=bool(np.isfinite(observer.state).all()),
        grown_MB=(memory[-1] - memory[len(memory) // 10]) / 1e3,
        seconds=seconds,
    )


class _Nothing:
    """A track that keeps nothing."""

    dropped = 0

    def put(self, *_: float) -> bool:
        """Take one row."""
        return True

    def push(self, rows: NDArray[np.void]) -> int:
        """Take rows."""
        return len(rows)


def unnoticed(outcome: Outcome) -> int:
    """Frames lost or damaged on the way that neither end missed, and repeated ones that the host did not count."""
    harmed = {way: _harm(outcome.inflicted, way, "lost", "corrupted") for way in ("host", "board")}
    return (
        abs(harmed["host"] - outcome.frames["lost"])
        + abs(harmed["board"] - outcome.board_lost)
        + abs(_harm(outcome.inflicted, "host", "duplicated") - outcome.frames["repeated"])
    )


def _harm(inflicted: Mapping[str, int], way: str, *fates: str) -> int:
    return sum(inflicted.get(f"{fate}_to_{way}", 0) for fate in fates)


def _astray(outcome: Outcome) -> int:
    return max(abs(outcome.ticks - outcome.samples - outcome.lost) - outcome.block, 0)


def _resident_kB() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def rows(say: Say, scale: float = 1.0) -> list[Row]:
    """Both modes, each twice; `scale` shortens them."""
    figures = []
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as workers:
        for mode, long in LONG.items():
            samples = round(scale * long.samples)
            first, second = workers.map(endure, [mode] * 2, [samples] * 2)
            say(f"{mode}: {first.digests['capture']} and {second.digests['capture']}; {first.inflicted}")
            figures += [Row(f"{mode} mode: {name}", value, unit) for name, value, unit in _figures(first, second)]
    return figures


def _figures(first: Outcome, second: Outcome) -> list[tuple[str, float, str]]:
    same: dict[str, Any] = {name: digest == second.digests[name] for name, digest in first.digests.items()}
    harmed = sum(first.inflicted.values())
    return [
        ("samples taken", first.samples, "1"),
        ("record files that differ between the runs", sum(not equal for equal in same.values()), "1"),
        ("frames lost, damaged or repeated by the line", harmed, "1"),
        ("of them neither counted by host nor board", unnoticed(first), "1"),
        ("ticks in neither the samples nor the gaps, beyond the last block", _astray(first), "1"),
        ("estimates not finite", float(not first.finite), "1"),
        ("memory grown after the first tenth", first.grown_MB, "MB"),
        ("time per sample, board and codecs included", 1e6 * first.seconds / first.samples, "µs"),
    ]
