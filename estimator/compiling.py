"""The kernels compiled by several processes side by side.

A kernel is compiled after those that it calls, one after another.  What takes long and does not call one another is
compiled apart here; who calls it finds it in the cache.  A piece that is left out, or compiled twice because two
processes need it at once, costs time and nothing else.
"""

import fcntl
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from functools import partial
from typing import Any, NamedTuple

import numba
import numpy as np
from numba.core.caching import IndexDataCacheFile

from estimator.foresight import Foresight
from estimator.gain_matrix import GainMatrix, luenberger
from estimator.kernel import controller, flow, observer, plain, sensing
from estimator.kernel.compiled import generated, kernel_cache
from estimator.kernel.structures import Constants, Estimate, Interval, Sample
from estimator.observer import Observer
from estimator.record import Record
from estimator.settings import ControllerSettings, Device, Gain, ObserverSettings
from estimator.simulation import simulate
from estimator.trace.problem import Problem
from estimator.trace.scan import PARTS, scan

CONTROLLER = ControllerSettings(latency=1, force_quantum=1e-3, force_limit=10.0, sense_quantum=1e-5)
DEVICE = Device(4000.0, (1.6e6, 1.6e6, 0.0), (1.0, 1.0, 0.0), 1e-4, (-890.0, -890.0), (1e-4, 1e-4))
_MOST = 4  # the longest chain of pieces takes a third of the time of all
_SENSE = np.zeros((2, 2))


class Piece(NamedTuple):
    """Something to compile, and the pieces that it calls and that are worth waiting for."""

    compile: Callable[[], None]
    calls: tuple[str, ...] = ()


def compile_side_by_side(pieces: Mapping[str, Piece]) -> None:
    """Compile these pieces, those that they call before them, by as many processes as there are processors; with one,
    or where no process can be started or one is killed, what is left is the caller's.
    """
    processes = min(len(os.sched_getaffinity(0)), _MOST)
    if processes == 1:
        return
    with (
        suppress(OSError, BrokenProcessPool),
        ProcessPoolExecutor(processes, multiprocessing.get_context("spawn"), _begin) as pool,
    ):
        begun: dict[str, Future[None]] = {}
        done: set[str] = set()
        while len(done) < len(pieces):
            for name, piece in pieces.items():
                if name not in begun and done.issuperset(set(piece.calls) & set(pieces)):
                    begun[name] = pool.submit(_compile_piece, name)
            wait([task for name, task in begun.items() if name not in done], return_when=FIRST_COMPLETED)
            for name, task in begun.items():
                if task.done():
                    task.result()
                    done.add(name)


def _begin() -> None:
    """In a process of the pool: Ctrl-C ends it, as does the end of its parent."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    IndexDataCacheFile.save = _saved_alone  # type: ignore[method-assign]


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


_save: Any = IndexDataCacheFile.save


def _saved_alone(cache: IndexDataCacheFile, key: object, data: object) -> None:
    """Numba reads a kernel's index, adds to it and writes it anew: two at once would lose what one of them added."""
    with (kernel_cache() / "saving").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        _save(cache, key, data)


def _compile_piece(name: str) -> None:
    (PIECES | SELDOM)[name].compile()


def _for_types_of(kernel: Any, *arguments: object) -> None:
    """Compile a kernel for such arguments, without calling it."""
    kernel.compile(tuple(map(numba.typeof, arguments)))


def observer_with(gain: Gain = Gain.FADING) -> Observer:
    """Of two axes, with the types of a run."""
    return Observer(DEVICE, ObserverSettings(gain=gain, memory=0.01), CONTROLLER)


def _parts(made: Observer) -> tuple[Any, Constants, Estimate, Sample, Any]:
    """Settings, constants, estimate, sample and workspace as the entry kernels make them."""
    a = made.arrays
    return (
        a.settings[0],
        Constants(a.intensity, a.prior, a.spread, a.initial),
        Estimate(a.x, a.p, a.c, a.memory[0]),
        Sample(_SENSE[0], np.zeros((2, 1)), made.h),
        observer.workspace(a.settings[0], len(a.p), len(a.x)),
    )


def _predict() -> None:
    made = observer_with()
    settings, constants, estimate, sample, work = _parts(made)
    arguments = settings, made.active, constants.intensity, estimate, sample.u, sample.h, work
    _for_types_of(observer.predict, *arguments)


def _correct() -> None:
    made = observer_with()
    settings, constants, estimate, sample, work = _parts(made)
    _for_types_of(observer.correct, settings, made.active, constants, made.arrays.table, estimate, sample, work)


def _effect_forces() -> None:
    settings, _, estimate, _, work = _parts(observer_with())
    _for_types_of(flow.effect_forces, settings, estimate.x, estimate.x, work.flow.push)


def _effect_sense() -> None:
    settings, _, (x, _, _, _), sample, work = _parts(observer_with())
    signals, (by_states, by_constants) = work.flow.push.signals, np.hsplit(work.full, [settings["states"]])
    arguments = x, x, sample.z, signals, 0, 0, work.predicted, by_states, by_constants
    _for_types_of(generated().effect_sense, 0, 0, *arguments)


def _advance() -> None:
    settings, _, estimate, sample, work = _parts(observer_with())
    interval = Interval(0.0, sample.h, sample.u)
    _for_types_of(flow.advance, settings, interval, estimate.x, work.flow.out.shape[1], work.flow)


def _sensed_otherwise() -> None:
    settings, _, (x, _, _, _), _, work = _parts(observer_with())
    by_states, by_constants = np.hsplit(work.full, [settings["states"]])
    _for_types_of(sensing.sensed_otherwise, settings, x, x, work.flow.push, work.predicted, by_states, by_constants)


def _command() -> None:
    settings, _, estimate, _, work = _parts(observer_with())
    _for_types_of(controller.command, settings, estimate.memory, estimate.x, work, np.zeros(2))


def _plain() -> None:
    made = observer_with()
    settings, constants, estimate, sample, _ = _parts(made)
    x, p, c, own = plain.STEP.unpacked(*estimate, True)
    row = made.arrays.rows[0]
    _for_types_of(plain.STEP.advance, settings, constants, Estimate(x, p, c, estimate.memory), sample, own, row)


def _gain_mode() -> None:
    made = observer_with()
    board = luenberger(made.h)
    foresight = Foresight(made, board, 1, (0, 1))
    foresight.tell(*GainMatrix(made, board).solve(2), 0)
    foresight.follow(0, np.zeros((1, 4), np.int32))
    foresight.foresee(1, 1)


def watch(gain: Gain, *, vector: bool) -> None:
    """The scan of a record, as it closes a run and as tracing begins, by one of its kernels."""
    rows = 2 * PARTS
    record = Record(np.zeros((rows, 2)), np.zeros((rows, 2, 1)), np.full(rows, 1.0 / DEVICE.sample_rate))
    settings = ObserverSettings(gain=gain, memory=0.01)
    scan(Problem(record, DEVICE, settings, CONTROLLER), {"drive_gain": {}}, vector=vector)


def _observe() -> None:
    made = observer_with()
    made.run(_SENSE, _SENSE, truth=np.zeros((2, len(made.x))))


def _simulate() -> None:
    made = observer_with()
    simulate(made, made.state, _SENSE, sensitive=True)


def _tick() -> None:
    observer_with().tick(0.0, 0.0, 0.0, 0.0)


def _stationary() -> None:
    observer_with(Gain.STATIONARY)


PIECES = {
    "effect_forces": Piece(_effect_forces),
    "plain": Piece(_plain),
    "effect_sense": Piece(_effect_sense),
    "advance": Piece(_advance, ("effect_forces",)),
    "sensed_otherwise": Piece(_sensed_otherwise, ("effect_forces", "effect_sense")),
    "quick scan": Piece(partial(watch, Gain.FADING, vector=True), ("effect_forces", "effect_sense")),
    "correct": Piece(_correct, ("advance", "sensed_otherwise")),
    "predict": Piece(_predict, ("advance",)),
    "observe": Piece(_observe, ("predict", "correct", "plain")),
    "scan": Piece(partial(watch, Gain.FADING, vector=False), ("predict", "correct")),
    "command": Piece(_command, ("advance",)),
    "tick": Piece(_tick, ("observe", "command")),
    "simulate": Piece(_simulate, ("predict", "correct")),
}
"""By name; who comes first begins first."""
SELDOM = {
    "stationary": Piece(_stationary, ("predict", "correct")),
    "gain mode": Piece(_gain_mode),
}
"""What few runs need."""
