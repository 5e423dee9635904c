"""Methods that close the loop themselves: a run of their own, on the same emulated device with the same seed.

Emulated boards only, in lockstep: a method of the prior art has none of the loop's supervision, and is not let at
anything that moves.
"""

import math
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Protocol

import numpy as np

from estimator.observer import Observer
from estimator.prior_art.park_horowitz import ParkHorowitz
from hil.bench import Bench, override
from hil.boards.emulation import is_emulated, located, served
from hil.comparing.course import DAMPING, STIFFNESS, MethodCourse, Reference, parameters_of
from hil.comparing.observers import with_observer
from hil.errors import InputError
from hil.inputs.declared import board_device_of, controller_settings_of, observer_settings_of
from hil.records.truth import read_truth
from hil.running.preflight import configure, require_suitable
from hil.wire import client
from hil.wire.endpoint import Endpoint
from hil.wire.errors import LinkClosed, ProtocolError
from hil.wire.inproc import open_inproc
from hil.wire.link import Link
from hil.wire.link_name import Emulated, parse_link
from hil.wire.links import open_link
from hil.wire.messages import Identity, SafeReason

ADAPTIVE = "(d) Park–Horowitz"
WITHOUT_OFFSETS = "(c) control law without sense errors, its own loop"
_SILENT_S = 10.0


def require_emulated(link: str) -> str:
    """The link with its scenario as a path.  Raises InputError for a board that may move something real."""
    if not is_emulated(link):
        raise InputError(
            f"{link}: the prior art closes the loop with emulated boards only, since no limit stops it; "
            "give inproc:SCENARIO or pty:SCENARIO, or leave --link out"
        )
    return located(link)


def own_runs(
    bench: Bench, link: str, seconds: float
) -> Iterator[tuple[str, Callable[[], tuple[MethodCourse, Reference]]]]:
    """Names, and what runs each for so long, with the truth of that run."""
    bench = override(bench, {"loop": {"clock": "lockstep", "duration_s": seconds}}, bench.device.name or "bench")
    eleven = with_observer(bench, "gyro", bench.observer.gain)
    yield WITHOUT_OFFSETS, lambda: _run(eleven, link, WITHOUT_OFFSETS, Eleven)
    yield ADAPTIVE, lambda: _run(bench, link, ADAPTIVE, Adaptive)


class Controller(Protocol):
    """What closes a loop: sense codes and echoed drive codes in, drive codes out; and what it made of the run."""

    def __init__(self, bench: Bench, identity: Identity) -> None: ...

    def tick(self, vx: float, vy: float, ux: float, uy: float) -> tuple[int, int]:
        """One sample."""
        ...

    def course(self, name: str) -> MethodCourse:
        """The run, at every `estimate_every`-th sample."""
        ...


class Adaptive:
    """Park & Horowitz's controller."""

    def __init__(self, bench: Bench, identity: Identity) -> None:
        self._controller = ParkHorowitz(board_device_of(bench), controller_settings_of(bench, identity))
        self._every = bench.loop.estimate_every
        self.tick = self._controller.tick

    def course(self, name: str) -> MethodCourse:
        """As `Controller`."""
        reading, kept = self._controller.reading, slice(self._every - 1, None, self._every)
        return MethodCourse(
            name=name,
            kind="prior art",
            tick=reading.index[kept],
            angle=reading.angle[kept],
            rate=None if reading.rate is None else reading.rate[kept],
            parameters={label: float(values[-1]) for label, values in reading.parameters.items()},
            own_record=True,
            remark="written in Python",
        )


class Eleven:
    """The product's observer and control law, as the bench's variant has them."""

    def __init__(self, bench: Bench, identity: Identity) -> None:
        self._observer = Observer(
            board_device_of(bench), observer_settings_of(bench), controller_settings_of(bench, identity)
        )
        self._observer.enable_control(False)
        self._acquired = math.ceil(bench.observer.acquisition_s * identity.tick_rate_Hz)
        self._every = bench.loop.estimate_every
        self._rate = self._observer.names.index("rate")
        self._rows: list[tuple[int, float, float]] = []
        self._done = 0

    def tick(self, vx: float, vy: float, ux: float, uy: float) -> tuple[int, int]:
        """As `Controller`; a command that is no number is none."""
        if self._done == self._acquired:
            self._observer.enable_control(True)
        self._done += 1
        try:
            codes = self._observer.tick(vx, vy, ux, uy)
        except ValueError:  # not a number: it diverged
            codes = (0, 0)
        if self._done % self._every == 0:
            angle = float(self._observer.newest["angle"])
            self._rows.append((self._done - 1, angle, float(self._observer.state[self._rate])))
        return codes

    def course(self, name: str) -> MethodCourse:
        """As `Controller`."""
        tick, angle, rate = np.array(self._rows).reshape(-1, 3).T
        place = {label: self._observer.names.index(label) for label in self._observer.estimated}
        state = self._observer.state
        return MethodCourse(
            name=name,
            kind="prior art",
            tick=tick.astype(np.int64),
            angle=angle,
            rate=rate,
            parameters={label: float(state[place[label]]) for label in (*STIFFNESS, *DAMPING)},
            own_record=True,
        )


def _run(bench: Bench, link: str, name: str, make: type[Controller]) -> tuple[MethodCourse, Reference]:
    with tempfile.TemporaryDirectory() as place:
        truth = Path(place) / "truth.arrow"
        with _board(link, truth, bench.loop.seed) as opened:
            course = _closed(bench, opened, name, make)
        found = read_truth(truth)
        tick, angle, rate = (np.array(found[label]) for label in ("tick", "angle_rad", "rate_rad_s"))  # the file goes
        return course, Reference("truth", tick, angle, rate, parameters_of(found))


def _closed(bench: Bench, link: Link, name: str, make: type[Controller]) -> MethodCourse:
    """A run on an open link."""
    endpoint = Endpoint(link)
    identity = client.connect(endpoint, bench.link.timeout_s)
    require_suitable(bench, identity, link.name)
    configure(endpoint, identity, bench)
    controller = make(bench, identity)
    samples = round(bench.loop.duration_s * identity.tick_rate_Hz)
    client.arm(endpoint, bench.link.timeout_s)
    try:
        spent = _answered(endpoint, controller, samples, identity.latency_ticks)
    finally:
        client.make_safe(endpoint, SafeReason.HOST_REQUEST, bench.link.timeout_s)
    return replace(controller.course(name), cost_us=1e6 * spent / samples)


def _answered(endpoint: Endpoint, controller: Controller, samples: int, latency: int) -> float:
    """Answer so many samples; the processor time that it took."""
    done, spent, heard = 0, 0, time.monotonic()
    while done < samples:
        rows = endpoint.receive_rows(0.1)
        if rows:
            heard = time.monotonic()
        elif time.monotonic() - heard > _SILENT_S:
            raise ProtocolError(f"{endpoint.link.name}: silent for {_SILENT_S:g} s; start the board anew")
        for tick, vx, vy, ux, uy, _ in rows:
            begun = time.thread_time_ns()
            codes = controller.tick(vx, vy, ux, uy)
            spent += time.thread_time_ns() - begun
            endpoint.send_drive(*codes, tick + latency)
            done += 1
    return 1e-9 * spent


@contextmanager
def _board(link: str, truth: Path, seed: int | None) -> Iterator[Link]:
    """An emulated board, opened; its truth is whole afterwards."""
    place = parse_link(link)
    if isinstance(place, Emulated) and place.kind == "inproc":
        with closing(open_inproc(place, str(truth), seed)) as opened:
            yield opened
        return
    with served(link, truth=truth, seed=seed) as board:
        try:
            with closing(open_link(board.url)) as opened:
                yield opened
        except LinkClosed as error:
            raise InputError(f"{link}: {board.last_words or error}") from None
