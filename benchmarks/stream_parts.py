"""What a streamed row costs the host, part by part: gain mode in real time over a pty, the board a process of its own.

A part's time is the processor time of its calls less that of the parts inside them, so waiting does not count.  Nothing
of the path is replaced but the recorder behind the rings, which is another process's time, and nothing asks for
real-time scheduling.
"""

import time
import uuid
from collections.abc import Callable
from contextlib import ExitStack, closing
from typing import Any

from benchmarks.lockstep import bench_of
from benchmarks.row import Row, Say
from benchmarks.stream import EXAMPLE, RATES_HZ, scenario_at
from estimator.observer import Observer
from hil.bench import Bench
from hil.declared import controller_settings_of, device_of, observer_settings_of
from hil.emulation import emulator
from hil.loop.gain import GainLoop
from hil.loop.preflight import configure
from hil.loop.tracks import run_layouts
from hil.records.ring import Ring
from hil.wire import client
from hil.wire.endpoint import Endpoint
from hil.wire.link import Link
from hil.wire.links import open_link
from hil.wire.messages import SafeReason

SECONDS = 3.0


class Clock:
    """Processor time spent in wrapped calls, each without the wrapped calls inside it."""

    def __init__(self) -> None:
        self.spent_ns: dict[str, int] = {}
        self._inside: list[int] = []

    def wrap(self, owner: Any, method: str, part: str) -> None:
        """Have the calls of a method of this very object timed."""
        call: Callable[..., Any] = getattr(owner, method)

        def timed(*arguments: Any, **named: Any) -> Any:
            self._inside.append(0)
            begin = time.thread_time_ns()
            try:
                return call(*arguments, **named)
            finally:
                took = time.thread_time_ns() - begin
                self.spent_ns[part] = self.spent_ns.get(part, 0) + took - self._inside.pop()
                if self._inside:
                    self._inside[-1] += took

        setattr(owner, method, timed)


class Timed:
    """An object whose methods can be replaced, in front of one whose cannot."""

    def __init__(self, behind: Any) -> None:
        self._behind = behind

    def __getattr__(self, name: str) -> Any:
        return getattr(self._behind, name)


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
    link_end = Endpoint(link)
    identity = client.connect(link_end)

    observer = Observer(device_of(bench), observer_settings_of(bench), controller_settings_of(bench, identity))
    registers = configure(link_end, identity, bench)
    clock = Clock()
    endpoint: Any = Timed(link_end)
    samples = round(SECONDS * identity.tick_rate_Hz)
    with ExitStack() as stack:
        tracks = {}
        for stem, layout in run_layouts(observer, bench, identity).items():
            tracks[stem] = stack.enter_context(Ring.create(f"{uuid.uuid4()}", layout.dtype, samples))
            tracks[stem].unlink()
        loop = GainLoop(endpoint, identity, bench, observer, tracks, registers)
        clock.wrap(link, "receive", "waking and reading")
        clock.wrap(link, "send", "writing")
        clock.wrap(endpoint, "poll", "decoding")
        clock.wrap(endpoint, "send", "encoding")
        clock.wrap(observer, "run", "observer")
        clock.wrap(loop._foresight, "follow", "the board's law, for gaps")
        clock.wrap(loop._matrix, "solve", "matrix")
        clock.wrap(loop, "_keep", "rows of the record")
        for track in tracks.values():
            clock.wrap(track, "push", "rings")
        clock.wrap(loop, "run", "the rest of the loop")
        loop.arm()
        loop.run(round(0.5 * identity.tick_rate_Hz), lambda done: None, samples)  # closes the loop
        clock.spent_ns.clear()
        before = loop.counters.samples
        loop.run(samples, lambda done: None, samples)
        taken = loop.counters.samples - before
        loop.finish(SafeReason.HOST_REQUEST)
    return {part: spent / taken / 1e3 for part, spent in clock.spent_ns.items()}
