"""Measures one link and this machine the way the loop uses them, in a process of its own like the loop's.

`python -m hil.doctor.probe LINK [--stream]` connects, asks the board for its time again and again, and prints one JSON
object: who the board is, round trips, how late this process wakes up, and what the observer costs. It arms nothing but
an emulated board, which before that is in no hurry to answer (--stream).
"""

import json
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np

from hil.errors.ending import ExitCode, ending_of
from hil.running import realtime
from hil.wire import client
from hil.wire.endpoint import Endpoint
from hil.wire.errors import WireError
from hil.wire.links import open_link
from hil.wire.messages import Capabilities, ClockMode, Identity, SafeReason, TimeSync

if TYPE_CHECKING:
    from estimator.observer import Observer

ROUND_TRIPS, LONGEST_S = 2000, 3.0
_REST_S = 2e-4
_WAKE_UPS, _NAP_S = 500, 1e-3
_TICKS, _BLOCKS, _BLOCK = 2000, 40, 250
_PERCENTILES = (50.0, 99.0, 100.0)


def probe(url: str, *, stream: bool) -> dict[str, Any]:
    """Everything, as JSON values; with `stream` of a board that is armed and streams, on its own clock if it has one.

    Raises WireError as `open_link` and `client.connect`.
    """
    observer = _observer()
    endpoint = Endpoint(open_link(url))
    try:
        identity = client.connect(endpoint)
        from hil.running.safety.trim_outputs import read_outputs

        stream = stream and Capabilities.PACED in Capabilities(identity.capabilities)
        if stream:
            client.write_register(endpoint, "CLOCK_MODE", ClockMode.PACED)
            client.arm(endpoint)
        refused = realtime.prepare()
        begun_s = time.process_time()
        trips = round_trips(endpoint)
        busy_s = time.process_time() - begun_s
        return {
            "identity": identity._asdict(),
            "trims": [told._asdict() for told in read_outputs(endpoint, identity, 2.0)],
            "round_trip_us": percentiles(trips),
            "busy_us": 1e6 * busy_s / len(trips),
            "wake_up_us": percentiles(wake_ups()),
            "refused": refused,
            "streaming": stream,
            **_costs(observer),
        }
    finally:
        if stream:
            with suppress(WireError):
                client.make_safe(endpoint, SafeReason.HOST_REQUEST)
        endpoint.close()


def round_trips(endpoint: Endpoint) -> list[float]:
    """Times in s from sending TIME_SYNC to its answer; a lost one counts with what was waited for it."""
    times: list[float] = []
    end = time.monotonic() + LONGEST_S
    while len(times) < ROUND_TRIPS and time.monotonic() < end:
        asked = time.monotonic_ns()
        endpoint.send(TimeSync(asked, 0))
        give_up = time.monotonic() + 0.25
        while True:
            items = endpoint.poll(max(give_up - time.monotonic(), 0.0))
            answered = any(isinstance(i.message, TimeSync) and i.message.host_ns == asked for i in items)
            if answered or time.monotonic() >= give_up:
                break
        times.append(1e-9 * (time.monotonic_ns() - asked))
        time.sleep(_REST_S)  # as a loop rests: what carries the bytes of a pty needs a processor, too
    return times


def wake_ups() -> list[float]:
    """How much later than asked for this process wakes up, in s."""
    late = []
    for _ in range(_WAKE_UPS):
        due = time.monotonic() + _NAP_S
        time.sleep(_NAP_S)
        late.append(max(time.monotonic() - due, 0.0))
    return late


def percentiles(times_s: list[float]) -> dict[str, float]:
    """p50, p99 and the worst, in µs."""
    p50, p99, worst = (1e6 * float(value) for value in np.percentile(times_s, _PERCENTILES))
    return {"p50": p50, "p99": p99, "max": worst}


def _observer() -> "Observer":
    """The example S-slow's, loaded and run once."""
    from estimator.observer import Observer
    from hil.bench import load_bench
    from hil.bench.examples import find
    from hil.inputs.declared import board_device_of, controller_settings_of, observer_settings_of

    bench = load_bench(find("bench", "s-slow"))
    board = Identity(0, 0, 0, 0, bench.device.sample_rate_Hz, 2, 16, 16, 1e-5, 1e-3, 1, 0)
    observer = Observer(board_device_of(bench), observer_settings_of(bench), controller_settings_of(bench, board))
    observer.tick(0.0, 0.0, 0.0, 0.0)
    observer.run(np.zeros((_BLOCK, 2)), np.zeros((_BLOCK, 2)), every=_BLOCK)
    return observer


def _costs(observer: "Observer") -> dict[str, Any]:
    """What an observer costs, sample by sample, and in the median block."""
    ticks = [timed(lambda: observer.tick(0.0, 0.0, 0.0, 0.0)) for _ in range(_TICKS)]
    sense, drive = np.zeros((_BLOCK, 2)), np.zeros((_BLOCK, 2))
    blocks = [timed(lambda: observer.run(sense, drive, every=_BLOCK)) for _ in range(_BLOCKS)]
    return {"tick_us": percentiles(ticks), "block_us_per_row": 1e6 * float(np.median(blocks)) / _BLOCK}


def timed(work: Callable[[], object]) -> float:
    """Seconds that a piece of work took."""
    begin = time.perf_counter()
    work()
    return time.perf_counter() - begin


def main() -> int:
    """Probe the link on the command line."""
    try:
        print(json.dumps(probe(sys.argv[1], stream="--stream" in sys.argv[2:])))
    except Exception as error:  # noqa: BLE001 - whatever it was, it is told in one line
        ending = ending_of(error, keep=True)
        print(json.dumps({"error": ending.line}))
        return ending.code
    return ExitCode.GOOD


if __name__ == "__main__":
    sys.exit(main())
