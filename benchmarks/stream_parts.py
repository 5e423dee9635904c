"""What a streamed row costs the host, part by part: gain mode in real time over a pty, the board a process of its own.

The whole is the processor time of the loop's thread.  Of it the parts that C has as calls of their own are measured
by these calls, over the same samples; the rest is reading, writing, rows of the record, and waking up.  The recorder
behind the rings is another process's time, and nothing asks for real-time scheduling.
"""

import ctypes
import time
import uuid
from collections.abc import Callable
from contextlib import ExitStack, closing

import numpy as np
from numpy.typing import NDArray

from benchmarks.lockstep import bench_of
from benchmarks.row import Row, Say
from benchmarks.stream import EXAMPLE, RATES_HZ, scenario_at
from estimator.core.layout import OUTPUT
from estimator.core.library import LIBRARY as CORE
from estimator.observer import Observer
from hil.bench import Bench
from hil.boards.emulation import emulator
from hil.inputs.declared import controller_settings_of, device_of, observer_settings_of
from hil.running.gain import GainLoop
from hil.running.native import LIBRARY, MOST_ROWS, NONE, ROW, SAID_ROOM, Batch, ReceiverState, payload_sizes
from hil.running.preflight import configure
from hil.running.ring import Ring
from hil.running.skeleton import Setup
from hil.running.tracks import run_layouts
from hil.wire import client
from hil.wire.codec import pack, type_of
from hil.wire.endpoint import Endpoint
from hil.wire.framing import encode_frame
from hil.wire.link import Link
from hil.wire.links import open_link
from hil.wire.messages import SafeReason
from hil.wire.sense import Sense

SECONDS = 3.0
_CALLS = 200


def rows(say: Say) -> list[Row]:
    """Each rate."""
    figures = []
    for rate_Hz in RATES_HZ:
        bench = bench_of(EXAMPLE, device={"sample_rate_Hz": rate_Hz}, loop={"clock": "paced"})
        with scenario_at(rate_Hz) as scenario, emulator(scenario) as board, closing(open_link(board.url)) as link:
            parts = per_row_us(bench, link)
        label = f"{rate_Hz / 1e3:g} kS/s"
        figures += [Row(f"{label}, {part}", us, "µs a row") for part, us in parts.items()]
        total = sum(parts.values())
        figures.append(Row(f"{label}, all of the host's path", total, "µs a row"))
        say(f"{label}: {total:.2f} µs a row")
    return figures


def per_row_us(bench: Bench, link: Link) -> dict[str, float]:
    """µs a row by part."""
    endpoint = Endpoint(link)
    identity = client.connect(endpoint)
    observer = Observer(device_of(bench), observer_settings_of(bench), controller_settings_of(bench, identity))
    registers = configure(endpoint, identity, bench)
    samples = round(SECONDS * identity.tick_rate_Hz)
    with ExitStack() as stack:
        tracks = {}
        for stem, layout in run_layouts(observer, bench, identity).items():
            tracks[stem] = stack.enter_context(Ring.create(f"{uuid.uuid4()}", layout.dtype, 2 * samples))
            tracks[stem].unlink()
        loop = GainLoop(Setup(endpoint, identity, bench, observer, tracks, registers))
        loop.arm()
        loop.run(round(0.5 * identity.tick_rate_Hz), lambda done: None, samples)  # closes the loop
        before, begin = loop.counters.samples, time.thread_time_ns()
        loop.run(samples, lambda done: None, samples)
        whole = (time.thread_time_ns() - begin) / (loop.counters.samples - before) / 1e3
        loop.finish(SafeReason.HOST_REQUEST)
        capture = tracks["capture"].pop()
    block = bench.loop.block
    codes = np.column_stack([capture[name] for name in ("vx_code", "vy_code", "ux_code", "uy_code")])[-block:]
    parts = {
        "observer": _per_row(_observing(observer, loop, codes), block),
        "decoding": _per_row(_decoding(codes), block),
        "matrix": _per_row(lambda: loop._matrix.solve(block, block), block),
        "the board's law, for gaps": _per_row(lambda: loop._foresight.follow(0, codes), block),
    }
    return {**parts, "reading, writing, rows of the record": whole - sum(parts.values())}


def _per_row(call: Callable[[], object], block: int) -> float:
    call()
    begin = time.thread_time_ns()
    for _ in range(_CALLS):
        call()
    return (time.thread_time_ns() - begin) / _CALLS / block / 1e3


def _observing(observer: Observer, loop: GainLoop, codes: NDArray[np.int32]) -> Callable[[], object]:
    si = codes * loop._scale
    z = np.ascontiguousarray(si[:, :2]) / observer.volts
    u = np.ascontiguousarray(si[:, 2:]) / observer.scaling.drive
    rows = np.zeros(len(codes), OUTPUT)
    here, count = ctypes.c_void_p(observer.core), ctypes.c_int64(len(codes))

    def observe() -> None:
        CORE.estimator_samples(here, count, *[ctypes.c_void_p(array.ctypes.data) for array in (z, u, rows)])

    return observe


def _decoding(codes: NDArray[np.int32]) -> Callable[[], object]:
    sense = Sense(codes.astype(np.int32), 2, 0, 1)
    data = encode_frame(type_of(sense), 0, 0, pack(sense))
    rows, said, sizes = np.zeros(4 * MOST_ROWS, ROW), np.zeros(SAID_ROOM, np.uint8), payload_sizes()
    batch = Batch(rows.ctypes.data, len(rows), 0, said.ctypes.data, len(said), 0, ctypes.addressof(sizes))
    receiver = ReceiverState(expected=NONE)

    def decode() -> object:
        assert sizes is not None  # lent by its address
        batch.row_count, receiver.expected = 0, NONE
        return LIBRARY.turn_feed(ctypes.byref(receiver), None, ctypes.byref(batch), data, len(data))

    return decode
