"""Recording a sensor that speaks a vendor's framing: nothing to arm, nothing to drive, a record and its checks."""

import shlex
import time
from collections.abc import Callable
from contextlib import closing
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from hil.progress import Progress, Watcher
from hil.records.atomic import make_run_folder, occupied
from hil.records.layout import Column, Layout
from hil.records.rates import rates_layout, sensor_figures
from hil.records.result import Result, Sensor, save_result
from hil.records.runfolder import RunFolder
from hil.records.stream import BlockWriter
from hil.sensors.adapter import Adapter, Sample
from hil.sensors.port import Port, Source, hear, open_source, recognised
from hil.sensors.request import RecordRequest
from hil.sensors.ticks import TickCounter
from hil.wire.errors import LinkClosed, LinkError, WireError

SILENCE_S = 2.0
"""Without a datagram for so long the recording ends."""

LOST, DAMAGED = 1e-3, 1e-3
"""Shares of the samples beyond which a record is no good."""

BENIGN = ("starting up",)
"""Complaints of the sensor that leave a record good."""

_REPORT_S = 0.2


def record(
    request: RecordRequest,
    out: Path,
    *,
    progress: Watcher,
    report: Callable[[Path], object] | None = None,
) -> Path:
    """Record the sensor of `request` into a new run folder below `out`; returns the folder.

    `report` is called with the folder once all is in it, also of a recording that was interrupted, where a page is
    asked for.

    A recording that is interrupted or falls silent keeps what it has and says so. Raises LinkError, and leaves
    nothing, when the port cannot be opened or no datagram comes; KeyboardInterrupt is passed on after the record is
    closed.
    """
    link, port = request.link, request.port
    if port.adapter is None:
        port = recognised(port, link)
    assert port.adapter is not None
    with closing(open_source(port)) as source:
        stream = Stream(port, source)
        try:
            stream.begin(link)
        except LinkError as error:
            source.close()  # for who looks at other baud rates
            raise LinkError(str(error) + _elsewhere(port, link, stream.heard)) from None
        folder = make_run_folder(out, request.name or getattr(port.adapter, "name", "sensor"))
        interrupted = False
        try:
            with occupied(folder), BlockWriter(folder / "capture.arrow", stream.layout()) as writer:
                seconds = request.duration_s
                stopped = stream.record(
                    writer, seconds, lambda done: progress(Progress("record", done, round(seconds)))
                )
        except KeyboardInterrupt:
            interrupted, stopped = True, "stopped on request"
    _conclude(folder, port.adapter, stream, link, request.note, stopped)
    if report is not None and request.report:
        progress(Progress("report", 0, 0))
        report(folder)
    if interrupted:
        raise KeyboardInterrupt
    return folder


def _elsewhere(port: Port, link: str, heard: int) -> str:
    """Who speaks there at another baud rate, where bytes were heard that the adapter made nothing of."""
    if port.kind != "serial" or not heard:
        return ""
    try:
        found = recognised(port._replace(baud=0), link)
    except LinkError:
        return ""
    told = getattr(found.adapter, "name", "")
    return f"; {told} speaks there at {found.baud} baud: record {told}:{port.path}?baud={found.baud}"


class Stream:
    """What is heard of the port to numbered rows."""

    def __init__(self, port: Port, source: Source, *, stamped: bool = False) -> None:
        assert port.adapter is not None
        self._stamped = stamped
        self._port, self._adapter, self._source = port, port.adapter, source
        self._ticks: TickCounter | None = None
        self._numbered: list[tuple[int, Sample]] = []
        self._now_ns = 0
        self.longest_silence_s = 0.0
        self._channels: tuple[Column, ...] = ()
        self.heard = 0
        self.times: list[tuple[int, float]] = []  # (tick, host's clock) of the last sample of each batch

    @property
    def sample_rate_Hz(self) -> float:
        """By the sensor's clock; 0 until it is known."""
        return 0.0 if self._ticks is None else self._ticks.sample_rate_Hz

    @property
    def restarts(self) -> int:
        """How often the sensor's counter began anew."""
        return 0 if self._ticks is None else self._ticks.restarts

    def begin(self, link: str) -> None:
        """Listen until the sensor's sample rate is known. Raises LinkError when it never is."""
        begin = came = time.monotonic()
        while not self.sample_rate_Hz:
            try:
                data = hear(self._source, 0.1)
            except LinkClosed:
                if self._port.kind != "replay":
                    raise
                raise LinkError(
                    f"{link}: {self.heard} bytes, but not enough datagrams that tell their time; give the sample rate, "
                    "as ?rate=100"
                ) from None
            self.heard += len(data)
            came = time.monotonic() if self._take(data) else came
            now = time.monotonic()
            if (now - came > SILENCE_S or now - begin > 5 * SILENCE_S) and not self.sample_rate_Hz:
                heard = self._silence(self._adapter.crc_errors)
                raise LinkError(f"{link}: {heard} in {SILENCE_S:g} s; check supply, wiring and ?baud=")
        if not any(one.name.startswith("rate_") and one.unit == "rad/s" for one in self._adapter.channels):
            sent = ", ".join(column.name.removesuffix("_code") for column in self._adapter.channels)
            raise LinkError(
                f"{link}: {self._adapter.title} sends {sent or 'nothing'}, but no angular rate; set it up to send one"
            )

    def _silence(self, damaged: int) -> str:
        if not self.heard:
            return "nothing was heard"
        unknown = getattr(self._adapter, "unknown", {})
        if unknown:
            return f"none of its messages was heard, but {len(unknown)} other identifiers (0x{min(unknown):X}, …)"
        told = f", of {damaged} with a wrong checksum" if damaged else ""
        at = f" at {self._port.baud} baud" if self._port.kind == "serial" else ""
        return f"{self.heard} bytes were heard{at}, but not enough datagrams{told}"

    def layout(self) -> Layout:
        """Layout of the capture, of the channels that were heard by now."""
        self._channels = self._adapter.channels
        return rates_layout(
            self._channels, tick_rate_Hz=self.sample_rate_Hz, device=self._adapter.title,
            line_s=self._line_s if self._stamped else None,
        )  # fmt: skip

    @property
    def _line_s(self) -> float:
        """How long a frame is on a serial line, by its baud rate: ten bits a byte."""
        frames = getattr(self._adapter, "frames", 0)
        if self._port.kind != "serial" or not frames:
            return 0.0
        return 10.0 * float(getattr(self._adapter, "understood", 0)) / frames / self._port.baud

    def follow(self, writer: BlockWriter, ended: Callable[[], bool]) -> str:
        """Write rows, each with when it was read, until it has `ended`; returns why it ended early, "" if it did not.
        Silence does not end it."""
        self._numbered = []  # what came while the rate was learned has no time of its own
        last = time.monotonic()
        while not ended():
            try:
                if self._take(self._source.receive(0.05)):
                    last = time.monotonic()
            except WireError as error:
                return str(error)
            finally:
                self.longest_silence_s = max(self.longest_silence_s, time.monotonic() - last)
            if self._numbered:
                rows = [self._row(tick, sample) for tick, sample in self._numbered]
                writer.push(np.array(rows, writer.layout.dtype))
                self._numbered = []
        return ""

    def record(self, writer: BlockWriter, seconds: float, report: Callable[[int], None]) -> str:
        """Write rows for so many seconds of the sensor's time; returns why it ended early, "" if it did not."""
        wanted = round(seconds * self.sample_rate_Hz)
        last = reported = time.monotonic()
        while True:
            taken = [(tick, sample) for tick, sample in self._numbered if tick < wanted]
            done = len(taken) < len(self._numbered)
            if taken:
                rows = [self._row(tick, sample) for tick, sample in taken]
                writer.push(np.array(rows, writer.layout.dtype))
                last = time.monotonic()
            if done:
                return ""
            if time.monotonic() - last > SILENCE_S:
                return f"the sensor fell silent for {SILENCE_S:g} s"
            if taken and time.monotonic() - reported > _REPORT_S:
                reported = time.monotonic()
                report(int(taken[-1][0] / self.sample_rate_Hz))
            self._numbered = []
            try:
                self._take(hear(self._source, 0.1))
            except LinkClosed as error:
                return "" if self._port.kind == "replay" else str(error)
            except WireError as error:
                return str(error)

    def _row(self, tick: int, sample: Sample) -> tuple[float, ...]:
        codes = sample.codes[: len(self._channels)]
        lacking = (0.0,) * (len(self._channels) - len(codes))  # what the first samples did not have yet
        stamp = (self._now_ns,) if self._stamped else ()
        return (tick, *codes, *lacking, sample.status, sample.latency_us, *stamp, 0)

    def _take(self, data: Any) -> bool:
        """Whether a sample was in it."""
        self._now_ns = time.monotonic_ns()
        now = 1e-9 * self._now_ns
        samples = self._adapter.feed(data) if data else ()
        if not samples:
            return False
        if self._ticks is None:  # by now an adapter knows what counter its sensor has
            self._ticks = TickCounter(
                self._adapter.counter_size, self._adapter.rates_Hz, getattr(self._adapter, "counter_Hz", 0.0),
                self._port.rate_Hz, is_ours=getattr(self._adapter, "counts_itself", False),
            )  # fmt: skip
        numbered = self._ticks.number(list(samples), now)
        self._numbered += numbered
        if numbered and self._port.kind != "replay":
            self.times.append((numbered[-1][0], now))
        return True

    def host_rate_Hz(self) -> float | None:
        """Sample rate by the host's clock, from the earliest arrivals; None from less than a second."""
        if len(self.times) < 3 or self.times[-1][1] - self.times[0][1] < 1.0:
            return None
        ticks, times = np.array(self.times).T
        return float(np.polyfit(times - times[0], ticks, 1)[0])


_TOLD = {
    "restarts": "times the sensor's counter began anew: did it lose its supply?",
    "incomplete_cycles": "samples lacked one of their CAN messages and were dropped",
    "other_senders": "CAN frames of other senders of the same messages were left out",
}


def judge(result: Result, sensor: Sensor, stopped: str) -> tuple[str, list[str], list[str]]:
    """(verdict, reasons against the record, remarks)."""
    reasons = [stopped] if stopped else []
    remarks = []
    damaged = result.counters["crc_errors"]
    for count, limit, what in (
        (result.lost, LOST, "samples are missing in the sensor's count"),
        (damaged, DAMAGED, "datagrams had a wrong checksum"),
    ):
        if count > limit * (result.samples + result.lost):
            reasons.append(
                f"{count} {what}, more than {limit:.1%}: check wiring, baud rate and the load of this machine"
            )
        elif count:
            remarks.append(f"{count} {what}")
    for complaint, count in sensor.status.items():
        (remarks if complaint in BENIGN else reasons).append(f"the sensor reports: {complaint}, in {count} samples")
    for key, words in _TOLD.items():
        if result.counters.get(key):
            (reasons if key == "restarts" else remarks).append(f"{result.counters[key]} {words}")
    if sensor.latency_us is not None and sensor.latency_us.p999 > 1e6 / sensor.sample_rate_Hz:
        reasons.append(
            f"latency of {sensor.latency_us.p999:.0f} µs, more than a sample: lower the rate or raise the baud"
        )
    if stopped or not result.complete:
        return "interrupted", reasons, remarks
    return ("failed" if reasons else "good"), reasons, remarks


def counters_of(adapter: Adapter, stream: Stream) -> dict[str, int]:
    """What was counted of a sensor; of what is rare only what came."""
    more = {
        "restarts": stream.restarts,
        "incomplete_cycles": getattr(adapter, "incomplete", 0),
        "other_senders": getattr(adapter, "others", 0),
    }
    return {"crc_errors": adapter.crc_errors, "skipped_bytes": adapter.skipped} | {k: n for k, n in more.items() if n}


def _conclude(folder: Path, adapter: Adapter, stream: Stream, link: str, note: str | None, stopped: str) -> None:
    capture = RunFolder(folder).capture
    assert capture is not None
    sensor = sensor_figures(capture, adapter.complaints, host_rate_Hz=stream.host_rate_Hz())
    result = Result(
        run=folder.name,
        link=link,
        clock="real",
        seconds=float(capture.t_s[-1] - capture.t_s[0]) if len(capture) else 0.0,
        samples=len(capture),
        lost=capture.lost,
        counters=counters_of(adapter, stream),
        sensor=sensor,
        versions={"gyrohil": version("gyrohil")},
        operator_note=note,
        complete=capture.complete,
    )
    verdict, reasons, remarks = judge(result, sensor, stopped)
    after = f"hil {'export' if verdict == 'good' else 'check'} {shlex.quote(str(folder))}"
    said = {"verdict": verdict, "reasons": tuple(reasons), "remarks": tuple(remarks), "next": after}
    result = result.model_copy(update=said)
    save_result(folder / "result.json", result)
