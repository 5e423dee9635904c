"""The process the loop runs in: nothing else in its interpreter, told what to do once, reporting as it goes.

Started by `hil.loop.run` as `python -m hil.loop.worker`.  It reads one JSON order from standard input and
writes JSON lines to standard output: progress, and at the end either what happened or the error.  SIGTERM
ends the run well (SAFE, record closed); SIGHUP, which the kernel sends when the parent dies, ends it as fast
and leaves the record without its end marker.
"""

import json
import math
import os
import signal
import sys
from collections.abc import Callable, Mapping
from contextlib import closing, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, Self

from hil.bench import Bench
from hil.errors import InputError, told_to_user
from hil.loop import realtime
from hil.loop.load import LoadMeter
from hil.wire import client
from hil.wire.endpoint import Endpoint
from hil.wire.errors import WireError
from hil.wire.link import Link
from hil.wire.links import open_link
from hil.wire.messages import Capabilities, ClockMode, Identity, LoopMode, SafeReason

if TYPE_CHECKING:
    from estimator.observer import Observer
    from hil.loop.force import ForceLoop
    from hil.loop.gain import GainLoop
    from hil.records.recorder import Track

REPORTS = 200  # progress lines over a run; more where the board is asked for its time along with them
_RING_ROWS = {"capture": 1 << 19, "innovation": 1 << 19}  # a second of the fastest stream
_COVARIANCE_ROWS = {"covariance": 1 << 10}  # which are long, and few


@dataclass(frozen=True)
class Order:
    """What a worker is told."""

    bench: str  # JSON of the whole bench file
    link: str
    folder: str
    dry_run: bool = False
    truth: str | None = None

    @classmethod
    def read(cls) -> Self:
        """The order on standard input."""
        return cls(**json.loads(sys.stdin.readline()))


def tell(**line: Any) -> None:
    """One JSON line to the parent; where that does not read, or is gone, it is lost and holds nothing up."""
    with suppress(BlockingIOError, BrokenPipeError):
        os.write(1, json.dumps(line).encode() + b"\n")


def connect(order: Order, bench: Bench) -> Link:
    """The link of the order; an in-process board gets its truth file and seed."""
    kind, _, place = order.link.partition(":")
    if kind == "inproc":
        from hil.wire.inproc import open_inproc

        return open_inproc(place, order.truth, bench.loop.seed)
    return open_link(order.link)


def configure(endpoint: Endpoint, identity: Identity, bench: Bench) -> None:
    """Clock, watchdog, limits and, in gain mode, filter and dither into the board's registers."""
    from hil.declared import board_dither_of, board_filter_of, drive_limit_of

    clock = ClockMode[bench.loop.clock.upper()]
    able = Capabilities(identity.capabilities)
    if clock is ClockMode.LOCKSTEP and Capabilities.LOCKSTEP not in able:
        raise InputError(f'{endpoint.link.name}: the board cannot wait for the host; use [loop] clock = "real"')
    if clock is ClockMode.PACED and Capabilities.PACED not in able:
        raise InputError(
            f'{endpoint.link.name}: this board has no wall clock of its own; use [loop] clock = "lockstep"'
        )
    gain_mode = bench.loop.mode == "gain"
    if gain_mode and Capabilities.GAIN_MODE not in able:
        raise InputError(f'{endpoint.link.name}: the board cannot close the loop itself; use [loop] mode = "force"')
    ticks = max(math.ceil(bench.link.watchdog_s * identity.tick_rate_Hz), 2)
    client.write_register(endpoint, "CLOCK_MODE", clock)
    registers: dict[str, float] = {
        "LOOP_MODE": LoopMode.GAIN if gain_mode else LoopMode.FORCE,
        "BLOCK": bench.loop.block if gain_mode else 1,
        "WATCHDOG_TICKS": ticks,
        "DRIVE_LIMIT": drive_limit_of(bench, identity),
    }
    if gain_mode:
        board = board_filter_of(bench)
        registers |= {f"FILTER_A{i + 1}{j + 1}": board.a[i][j] for i in range(2) for j in range(2)}
        registers |= {f"FILTER_B{i + 1}": board.b[i] for i in range(2)}
        registers |= {f"FILTER_C{i + 1}": board.c[i] for i in range(2)}
        registers |= {"FILTER_DELAY": board.delay}
        registers |= dict(zip(("DITHER_AMPLITUDE", "DITHER_SEED"), board_dither_of(bench, identity), strict=True))
    for name, value in registers.items():
        client.write_register(endpoint, name, value)


def work(order: Order) -> dict[str, Any]:
    """Carry out an order; what happened, as JSON values."""
    bench = Bench.model_validate_json(order.bench, strict=False)
    tell(stage="connect", done=0, total=0, note=order.link)
    with closing(connect(order, bench)) as link:
        endpoint = Endpoint(link)
        identity = client.connect(endpoint, bench.link.timeout_s)
        from hil.declared import require_agreement

        require_agreement(bench, identity, order.link)
        if order.dry_run:
            return {"identity": identity._asdict()}
        return {"identity": identity._asdict(), **_loop(order, bench, endpoint, identity)}


def _loop(order: Order, bench: Bench, endpoint: Endpoint, identity: Identity) -> dict[str, Any]:
    from estimator.kernel.compiled import is_warm

    note = "" if is_warm() else "compiling the kernels, once; about half a minute"
    tell(stage="prepare", done=0, total=0, note=note)
    from estimator.foresight import rehearse
    from estimator.observer import Observer
    from hil.declared import board_filter_of, controller_settings_of, device_of, observer_settings_of
    from hil.loop.clock import EXCHANGES_PER_S, ClockExchanges
    from hil.loop.tracks import run_layouts
    from hil.records.recorder import record_apart, record_here

    lockstep = bench.loop.clock == "lockstep"

    def make_observer() -> Observer:
        return Observer(device_of(bench), observer_settings_of(bench), controller_settings_of(bench, identity))

    # Loads or compiles the kernels before the board is armed.
    if bench.loop.mode == "gain":
        rehearse(make_observer(), board_filter_of(bench))
    else:
        make_observer().tick(0.0, 0.0, 0.0, 0.0)
    observer = make_observer()
    layouts = run_layouts(observer, bench, identity)
    configure(endpoint, identity, bench)
    folder = Path(order.folder)
    recording = (
        record_here(folder, layouts)
        if lockstep
        else record_apart(
            folder, layouts, ring_rows=_COVARIANCE_ROWS | (_RING_ROWS if bench.loop.mode == "gain" else {})
        )
    )
    samples = round(bench.loop.duration_s * identity.tick_rate_Hz)
    report_every = max(samples // REPORTS, 1)
    if not lockstep:
        report_every = max(min(report_every, int(identity.tick_rate_Hz / EXCHANGES_PER_S)), 1)
    stopped = ""
    refused: list[str] = []
    with recording:
        loop = make_loop(endpoint, identity, bench, observer, recording.tracks)
        orphaned = _on_signals(loop)
        if not lockstep:
            refused = realtime.prepare()
            os.set_blocking(1, False)
        clock = None if lockstep else ClockExchanges(endpoint, recording["clock"])
        if clock is not None:
            clock.burst()
            loop.between = clock.follow

        def report(done: int) -> None:
            tell(stage="run", done=done, total=samples)
            if clock is not None:
                clock.ask()

        armed = client.arm(endpoint, bench.link.timeout_s)
        meter = LoadMeter()
        try:
            loop.run(samples, report, report_every)
            if loop.counters.residual_safe:
                limit = bench.limits.residual_safe
                stopped = f"the innovation exceeded [limits] residual_safe = {limit:g} × the noise"
            elif loop.stop:
                stopped = "stopped on request"
        except WireError as error:
            stopped = str(error)
        finally:
            meter.stop()
            loop.finish(_why_safe(loop))
            os.set_blocking(1, True)
        if clock is not None and loop.counters.board and not orphaned():
            with suppress(WireError):
                clock.burst()
        dropped = recording.dropped
        if orphaned():
            raise InterruptedError("the parent process is gone")
    rx = endpoint.rx
    counters = asdict(loop.counters) | {
        "frames_lost": rx.lost,
        "frames_repeated": rx.repeated,
        "frames_damaged": rx.bad,
    }
    board = counters.pop("board")
    # The board counts since its power-up; what it counted before this run is none of it.
    counters |= {f"board_{name}": max(value - getattr(armed, name), 0) for name, value in board.items()}
    counters |= {f"records_dropped_{stem}": count for stem, count in dropped.items() if count}
    return {"counters": counters, "stopped": stopped, "refused": refused, "load": meter.load()}


def make_loop(
    endpoint: Endpoint, identity: Identity, bench: Bench, observer: "Observer", tracks: "Mapping[str, Track]"
) -> "ForceLoop | GainLoop":
    """The loop of the bench's mode, with a board that is configured for it."""
    from hil.loop.force import ForceLoop
    from hil.loop.gain import GainLoop

    return (GainLoop if bench.loop.mode == "gain" else ForceLoop)(endpoint, identity, bench, observer, tracks)


def _on_signals(loop: "ForceLoop | GainLoop") -> Callable[[], bool]:
    """SIGTERM and SIGHUP end the loop; the returned function tells whether it was the latter."""
    orphaned = False

    def stop(number: int, _: FrameType | None) -> None:
        nonlocal orphaned
        loop.stop = True
        orphaned = orphaned or number == signal.SIGHUP

    signal.signal(signal.SIGTERM, stop)
    signal.signal(signal.SIGHUP, stop)
    return lambda: orphaned


def _why_safe(loop: "ForceLoop | GainLoop") -> SafeReason:
    """What the board is told when the loop has ended."""
    if loop.counters.residual_safe:
        return SafeReason.RESIDUAL
    return SafeReason.INTERRUPTED if loop.stop else SafeReason.HOST_REQUEST


def main() -> int:
    """Read the order, carry it out, report."""
    realtime.end_with_parent()
    order = Order.read()
    try:
        outcome = work(order)
    except InterruptedError:  # nobody is left to be told
        return 1
    except Exception as error:
        if (message := told_to_user(error)) is None:
            raise
        tell(error=type(error).__name__, message=message)
        return 2
    tell(outcome=outcome)
    return 0


if __name__ == "__main__":
    sys.exit(main())
