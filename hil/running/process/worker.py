"""The process the loop runs in: nothing else in its interpreter, told what to do once, reporting as it goes.

Started by `supervision` as `python -m hil.running.process.worker`.  It reads one JSON order from standard input and
writes JSON lines to standard output: progress, `armed` before the first byte of ARM, `stopping` when the run ends
early, `safety` when the board was told to be SAFE, and at the end either what happened or the error.  SIGTERM and
SIGINT end the run well (SAFE, record closed); SIGHUP, which the kernel sends when the parent dies, ends it as fast and
leaves the record without its end marker.
"""

import atexit
import json
import os
import signal
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import asdict, dataclass
from importlib import import_module
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, Self

from hil.bench import Bench
from hil.errors.ending import ExitCode, ending_of, line_of
from hil.numbers import finite
from hil.running import realtime
from hil.running.process.control import LOOKS_PER_S, Control
from hil.running.process.load import LoadMeter
from hil.running.request import RunRequest
from hil.running.safety.latching import reason_name
from hil.wire import client
from hil.wire.endpoint import Endpoint
from hil.wire.errors import ProtocolError, WireError
from hil.wire.link import Link
from hil.wire.link_name import Emulated, parse_link
from hil.wire.links import open_link
from hil.wire.messages import Identity, SafeReason, Status

if TYPE_CHECKING:
    from estimator.observer import Observer
    from hil.running.loop.skeleton import Loop
    from hil.running.recording.recorder import Recording, Track
    from hil.running.safety.trim_outputs import Output

REPORTS = 200  # progress lines over a run in lockstep; else they come as the board is asked for its time
_RING_ROWS = {"capture": 1 << 19, "innovation": 1 << 19}  # a second of the fastest stream
_COVARIANCE_ROWS = {"covariance": 1 << 10}  # which are long, and few
_NEEDED = (
    "hil.running.safety.preflight",
    "hil.running.safety.trim_outputs",
    "hil.running.process.clock",
    "hil.running.loop.force",
    "hil.running.loop.gain",
)  # by whatever it is told to do
_NOTHING_WRITTEN: Mapping[str, float] = {}


@dataclass(frozen=True)
class Order:
    request: RunRequest  # its link is that of the board, which serves by now
    folder: str
    control: int | None = None  # descriptor of a socket to the clients of the run

    @classmethod
    def read(cls) -> Self | None:
        """The order on standard input; None where the parent has gone before it gave one."""
        line = sys.stdin.readline()
        if not line.endswith("\n"):
            return None
        told = json.loads(line)
        return cls(**told | {"request": RunRequest.of_json(told["request"])})

    @property
    def line(self) -> bytes:
        return json.dumps({**vars(self), "request": self.request.as_json()}).encode() + b"\n"


def tell(**line: Any) -> None:
    """One JSON line to the parent; where that does not read, or is gone, it is lost and holds nothing up."""
    with suppress(BlockingIOError, BrokenPipeError):
        os.write(realtime.line(), json.dumps(line).encode() + b"\n")


Say = Callable[..., None]


def untold(**_: Any) -> None:
    """Instead of `tell`, where nobody follows a run step by step."""


def connect(request: RunRequest) -> Link:
    """The link of the request; an in-process board gets its truth file and seed."""
    link, truth = parse_link(request.link), request.file("truth")
    if isinstance(link, Emulated):
        from hil.wire.inproc import open_inproc

        return open_inproc(link, None if truth is None else str(truth), request.bench.loop.seed)
    return open_link(link)


def work(order: Order, tell: Say = tell, *, own_process: bool = True) -> dict[str, Any]:
    """Carry out an order; what happened, as JSON values.

    own_process: signals of this process are for the loop; without, in lockstep only, they stay whose they are.
    """
    request, bench = order.request, order.request.bench
    tell(stage="connect", done=0, total=0, note=request.link)
    with closing(connect(request)) as link:
        endpoint = Endpoint(link)
        identity = client.connect(endpoint, bench.link.timeout_s)
        from hil.running.safety.preflight import configure, require_clock, require_suitable, require_undone
        from hil.running.safety.trim_outputs import require_outputs, zeroed

        require_undone(bench)
        require_suitable(bench, identity, request.link)
        tried = _try_plugins(bench, identity, tell, own_process=own_process)
        outputs = require_outputs(endpoint, identity, bench)
        registers = configure(endpoint, identity, bench) | zeroed(endpoint, outputs, bench.link.timeout_s)
        if bench.loop.clock != "lockstep":
            require_clock(endpoint)
        if request.dry_run:
            trims = [output.told._asdict() for output in outputs]
            return {"identity": identity._asdict(), "plugins": tried, "trims": trims}
        happened = _loop(order, endpoint, identity, registers, outputs, tell, own_process=own_process)
        return {"identity": identity._asdict(), **happened, "plugins": [*tried, *happened["plugins"]]}


def _try_plugins(bench: Bench, identity: Identity, tell: Say, *, own_process: bool) -> list[str]:
    """Run the plug-ins of the bench, where it has any, on the declared device: remarks on them.

    Raises InputError or PluginError. From here on one that does not come back ends this process, which says why.
    """
    if bench.observer.plugin is None and bench.controller.plugin is None:
        return []
    from hil.plugins.of_bench import tried, watch

    tell(stage="prepare", done=0, total=0, note="the plug-ins are tried")
    if own_process:
        watch(bench, realtime.line())
    return tried(bench, identity)


def _loop(
    order: Order,
    endpoint: Endpoint,
    identity: Identity,
    registers: Mapping[str, float],
    outputs: "Sequence[Output]",
    tell: Say,
    *,
    own_process: bool,
) -> dict[str, Any]:
    import numpy as np

    np.seterr(all="ignore")  # an observer that diverges is told by its numbers, not by NumPy
    tell(stage="prepare", done=0, total=0, note="")
    from estimator.observer import Observer
    from hil.inputs.declared import board_device_of, controller_settings_of, observer_settings_of
    from hil.running.process.optional import unknown_parts
    from hil.running.recording.recorder import record_apart, record_here
    from hil.running.recording.tracks import run_layouts

    bench = order.request.bench
    lockstep = bench.loop.clock == "lockstep"

    def make_observer() -> Observer:
        return Observer(board_device_of(bench), observer_settings_of(bench), controller_settings_of(bench, identity))

    observer, strange = make_observer(), False
    if names := {bench.observer.plugin, bench.controller.plugin} - {None}:
        from hil.plugins.finding import TABLE
        from hil.plugins.of_bench import loop_observer

        observer = loop_observer(bench, identity)
        strange = any(name is not None and not name.endswith(TABLE) for name in names)
    if outputs:
        observer.declare_trims([output.electrode for output in outputs])
    layouts = run_layouts(observer, bench, identity, outputs)
    folder = Path(order.folder)
    control = None if order.control is None else Control(order.control)
    if lockstep and control is None and not (strange and own_process):  # whose record is to outlive this process
        recording = record_here(folder, layouts)
    else:
        recording = record_apart(
            folder,
            layouts,
            wait=lockstep,
            ring_rows=_COVARIANCE_ROWS | (_RING_ROWS if bench.loop.in_blocks else {}),
            shown=None if control is None else lambda rings: control.show(rings, layouts),
        )
    loop = make_loop(endpoint, identity, bench, observer, recording.tracks, registers, outputs)
    line = None if control is None else _Line(control, loop, observer, bench)
    driven = _Driven(loop, recording, bench, identity, tell, own_process=own_process, line=line)
    driven.run(endpoint)
    if control is not None:
        control.close()
    if bench.controller.enabled and bench.device.axes == 2 and not loop.wrong:
        loop.safety.signs = loop.opening.wrong_way(make_observer)
    rx = endpoint.rx
    counters = asdict(loop.counters) | {
        "frames_lost": rx.lost,
        "frames_repeated": rx.repeated,
        "frames_damaged": rx.bad,
        "frames_passed_over": rx.passed_over,
    }
    board = counters.pop("board")
    # The board counts since its power-up; what it counted before this run is none of it.
    before = driven.armed
    counters |= {f"board_{name}": max(value - getattr(before, name, 0), 0) for name, value in board.items()}
    counters |= {f"records_dropped_{stem}": count for stem, count in driven.dropped.items() if count}
    counters |= {"stops": len(loop.safety.stops)}
    return {
        "counters": counters,
        "unknown": unknown_parts(identity, rx.passed_over),
        "stopped": driven.why_stopped,
        "cure": driven.cure,
        "failed": driven.failed,
        "refused": driven.refused,
        **({} if driven.load is None else {"load": driven.load}),
        "safety": loop.safety.told,
        **_told_by(observer),
    }


def _told_by(observer: "Observer") -> dict[str, Any]:
    """What the plug-ins of a run tell of themselves, and a line on each thing that ended nothing; JSON values."""
    from hil.plugins.plugged import Plugged

    if not isinstance(observer, Plugged):
        return {"algorithm": [], "plugins": []}
    told = [{**one._asdict(), "value": finite(one.value)} for one in observer.figures]
    return {"algorithm": told, "plugins": observer.remarks}


class _Driven:
    """The part of a run in which the board is armed: whatever comes, it is told to be SAFE, and that is told first.

    Attributes:
        stopped: why the run ended early, "" where it did not.
        failed: names of the class and bases of the wire's error that ended it.
        refused: what the system refused the loop.
        armed: what the board said to the first ARM.
        dropped: rows that the recorder did not take, by file.
    """

    def __init__(
        self,
        loop: "Loop",
        recording: "Recording",
        bench: Bench,
        identity: Identity,
        tell: Say,
        *,
        own_process: bool,
        line: "_Line | None" = None,
    ) -> None:
        self._loop, self._recording, self._bench = loop, recording, bench
        self._tell, self._own_process, self._line = tell, own_process, line
        self._lockstep = bench.loop.clock == "lockstep"
        self._samples = round(bench.loop.duration_s * identity.tick_rate_Hz)
        self._rate_Hz = identity.tick_rate_Hz
        self._board = identity.unique_id
        self._done = 0
        self.stopped = ""
        self.cure = ""
        self.failed: list[str] = []
        self.refused: list[str] = []
        self.armed: Status | None = None
        self._meter: LoadMeter | None = None
        self.dropped: dict[str, int] = {}

    @property
    def load(self) -> "dict[str, Any] | None":
        """What loop and recorder needed of the machine while the board was driven."""
        return None if self._meter is None else self._meter.load()

    @property
    def why_stopped(self) -> str:
        """Why the run ended early, with what the record has to say to it."""
        signs = self._loop.safety.signs
        return f"{self.stopped}; {signs}" if signs and self.stopped else self.stopped

    def run(self, endpoint: Endpoint) -> None:
        """All of it. Raises WireError where the board could not be armed, InterruptedError without a parent."""
        from hil.running.recording.recorder import RecorderError

        try:
            with self._recording:
                self._armed(endpoint)
        except RecorderError as error:  # as it was closed
            self._loop.safety.recorder = self._loop.safety.recorder or str(error)
            self.stopped = self.stopped or str(error)

    def _armed(self, endpoint: Endpoint) -> None:
        from hil.running.process.clock import EXCHANGES_PER_S, ClockExchanges

        loop, lockstep = self._loop, self._lockstep
        line = self._line
        report_every = self._samples // REPORTS
        if line is not None:
            report_every = min(report_every, int(self._rate_Hz / LOOKS_PER_S))
        if not lockstep:  # each costs a sample or two
            report_every = int(self._rate_Hz / (EXCHANGES_PER_S if line is None else LOOKS_PER_S))
        report_every = max(report_every, 1)
        orphaned = _on_signals(loop) if self._own_process else lambda: False
        if line is not None:
            line.control.show_process()
        if not lockstep:
            self.refused = realtime.prepare()
            os.set_blocking(1, False)
        clock = None if lockstep else ClockExchanges(endpoint, self._recording["clock"])
        if clock is not None:
            clock.burst()
            loop.between = clock.follow
        loop.trouble = self._recording.trouble
        loop.board.waiting = self._wait

        def report(done: int) -> None:
            self._done = done
            self._tell(stage="run", done=done, total=self._samples)
            if clock is not None:
                clock.ask()
            if line is not None:
                line.look()

        if loop.stop:  # asked to end before it began: nothing is armed
            self.stopped = "stopped on request"
            return
        self._tell(armed=True, board=self._board)
        meter = LoadMeter(self._recording.busy_s)
        failed: OSError | WireError | None = None
        through = False
        try:
            self.armed = loop.arm()
            if line is not None:
                line.control.tell(armed=True)
            loop.run(self._samples, report, report_every)
            through = not (loop.stop or loop.counters.residual_safe)
        except (OSError, WireError) as error:
            failed = error
        finally:  # after a fault of the loop itself, too
            meter.stop()
            if not through:  # before SAFE is waited for: others may have to stop with this one
                self._tell(stopping=True)
            loop.finish(_why_safe(loop))
            if not lockstep:
                os.set_blocking(1, True)
            self._tell(safety=loop.safety.told)
        self._conclude(failed)
        if clock is not None and loop.counters.board and not orphaned():
            with suppress(WireError):
                clock.burst()
        self.dropped = self._recording.dropped
        if orphaned():
            raise InterruptedError("the parent process is gone")
        self._meter = meter

    def _conclude(self, failed: OSError | WireError | None) -> None:
        loop, limits = self._loop, self._bench.limits
        if isinstance(failed, WireError):
            self.stopped, self.failed = str(failed), _kinds(failed)
            if isinstance(failed, ProtocolError):
                loop.safety.broke, self.cure = str(failed), failed.cure
        elif failed is not None:  # of a file: the record is part of the run
            loop.safety.recorder = line_of(failed)
            self.stopped = f"the record ended: {loop.safety.recorder}"
        elif loop.wrong:
            self.stopped, self.cure = f"nothing was driven: {loop.wrong}", loop.wrong.rpartition("; ")[2]
        elif loop.counters.residual_safe:
            self.stopped = f"the innovation exceeded [limits] residual_safe = {limits.residual_safe:g} × the noise"
        elif loop.stop:
            self.stopped = "stopped on request"

    def _wait(self, seconds: float) -> None:
        note = f"waiting for the board, {seconds:.0f} s"
        self._tell(stage="run", done=self._done, total=self._samples, note=note)


class _Line:
    """What goes over the line to the clients of the run: each message is a table with one of `track` and `loop` (and
    a descriptor), `armed`, `changed` and `safe`; what comes are tables of settings.
    """

    def __init__(self, control: Control, loop: "Loop", observer: "Observer", bench: Bench) -> None:
        from hil.running.process.live_settings import LiveSettings

        self.control, self._loop = control, loop
        self._settings = LiveSettings(observer, bench)
        loop.board.answered = self._answered

    def look(self) -> None:
        """Change what was asked to be changed, from the next sample on."""
        for settings in self.control.asked():
            changed = self._settings.change(settings)
            newest = self._loop.newest
            self.control.tell(changed=changed, tick=0 if newest is None else newest + 1)

    def _answered(self, status: Status) -> None:
        self.control.tell(safe={"tick": status.tick, "reason": reason_name(status.reason)})


def make_loop(
    endpoint: Endpoint,
    identity: Identity,
    bench: Bench,
    observer: "Observer",
    tracks: "Mapping[str, Track]",
    registers: Mapping[str, float] = _NOTHING_WRITTEN,
    outputs: "Sequence[Output]" = (),
) -> "Loop":
    """The loop of the bench's mode, with a board that is configured for it by `registers` and has trim `outputs`."""
    from hil.running.loop.board import BoardLoop
    from hil.running.loop.force import ForceLoop
    from hil.running.loop.gain import GainLoop
    from hil.running.loop.skeleton import Setup

    kinds: dict[str, type[ForceLoop | GainLoop | BoardLoop]]
    kinds = {"force": ForceLoop, "gain": GainLoop, "board": BoardLoop}
    return kinds[bench.loop.mode](Setup(endpoint, identity, bench, observer, tracks, registers, outputs))


def _on_signals(loop: "Loop") -> Callable[[], bool]:
    """SIGTERM, SIGINT and SIGHUP end the loop; the returned function tells whether it was the last."""
    orphaned = False

    def stop(number: int, _: FrameType | None) -> None:
        nonlocal orphaned
        loop.stop = True
        orphaned = orphaned or number == signal.SIGHUP

    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, stop)
    loop.waker, told = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)  # a turn in C is not between two lines of Python
    signal.set_wakeup_fd(told, warn_on_full_buffer=False)
    return lambda: orphaned


def _why_safe(loop: "Loop") -> SafeReason:
    """What the board is told when the loop has ended."""
    if loop.counters.residual_safe:
        return SafeReason.RESIDUAL
    return SafeReason.INTERRUPTED if loop.stop else SafeReason.HOST_REQUEST


def _kinds(error: BaseException) -> list[str]:
    return [kind.__name__ for kind in type(error).__mro__]


def main() -> int:
    realtime.end_with_parent()
    realtime.keep_line()
    for module in _NEEDED:
        import_module(module)
    order = Order.read()
    if order is None:  # an early Ctrl-C: nobody is left to be told
        return ExitCode.INTERRUPTED
    try:
        outcome = work(order)
    except InterruptedError:  # nobody is left to be told
        return ExitCode.INTERRUPTED
    except Exception as error:  # noqa: BLE001 - whatever it was, it is told in one line
        ending = ending_of(error, keep=True)
        if ending.code is ExitCode.FAULT:
            tell(fault=ending.line)
        else:
            tell(error=_kinds(error), message=ending.line)
        return ending.code
    tell(outcome=outcome)
    return ExitCode.GOOD


if __name__ == "__main__":
    ended = main()
    atexit._run_exitfuncs()
    os._exit(ended)  # to take all modules apart would take a tenth of a second, for which the verdict waits
