"""Recording a sensor that speaks a vendor's framing: nothing to arm, nothing to drive, a record and its checks."""

import shlex
import time
from collections.abc import Callable
from contextlib import closing
from importlib.metadata import version
from pathlib import Path

import numpy as np

from hil.progress import Progress, Watcher
from hil.records.atomic import make_run_folder
from hil.records.layout import Layout
from hil.records.occupied import occupied
from hil.records.rates import rates_layout, sensor_figures
from hil.records.result import Result, Sensor, save_result
from hil.records.runfolder import RunFolder
from hil.records.stream import BlockWriter
from hil.records.summary import lost_samples
from hil.sensors.adapter import Adapter
from hil.sensors.request import RecordRequest
from hil.sensors.ticks import TickCounter
from hil.wire.errors import LinkError, WireError
from hil.wire.link import Link
from hil.wire.serial_link import open_serial

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
    port, link = request.port, request.link
    with closing(open_serial(port.path, port.baud)) as serial:
        stream = _Stream(port.adapter, serial)
        stream.begin(link)
        folder = make_run_folder(out, request.name)
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


class _Stream:
    """Bytes of the port to numbered rows."""

    def __init__(self, adapter: Adapter, link: Link) -> None:
        self._adapter, self._link = adapter, link
        self._ticks = TickCounter(adapter.counter_size, adapter.rates_Hz)
        self._rows: list[tuple[int, ...]] = []
        self.times: list[tuple[int, float]] = []  # (tick, host's clock) of the last sample of each batch

    @property
    def sample_rate_Hz(self) -> float:
        """By the sensor's clock."""
        return self._ticks.sample_rate_Hz

    def begin(self, link: str) -> None:
        """Listen until the sensor's sample rate is known. Raises LinkError when it never is."""
        end = time.monotonic() + SILENCE_S
        heard = 0
        while not self._ticks.step:
            data = self._hear(0.1)
            heard += len(data)
            self._take(data)
            if time.monotonic() > end and not self._ticks.step:
                what = "nothing was heard" if not heard else f"{heard} bytes were heard, but not enough datagrams"
                raise LinkError(f"{link}: {what} in {SILENCE_S:g} s; check supply, wiring and ?baud=")

    def layout(self) -> Layout:
        """Layout of the capture."""
        return rates_layout(self._adapter.channels, tick_rate_Hz=self.sample_rate_Hz, device=self._adapter.title)

    def record(self, writer: BlockWriter, seconds: float, report: Callable[[int], None]) -> str:
        """Write rows for so many seconds of the sensor's time; returns why it ended early, "" if it did not."""
        wanted = round(seconds * self.sample_rate_Hz)
        last = reported = time.monotonic()
        while True:
            rows = [row for row in self._rows if row[0] < wanted]
            done = len(rows) < len(self._rows)
            if rows:
                writer.push(np.array(rows, writer.layout.dtype))
                last = time.monotonic()
            if done:
                return ""
            if time.monotonic() - last > SILENCE_S:
                return f"the sensor fell silent for {SILENCE_S:g} s"
            if rows and time.monotonic() - reported > _REPORT_S:
                reported = time.monotonic()
                report(int(rows[-1][0] / self.sample_rate_Hz))
            self._rows = []
            try:
                self._take(self._hear(0.1))
            except WireError as error:
                return str(error)

    def _hear(self, timeout_s: float) -> bytes:
        """All that has arrived: how much time its samples stand for must not depend on when we looked."""
        data = self._link.receive(timeout_s)
        while data and (more := self._link.receive(0.0)):
            data += more
        return data

    def _take(self, data: bytes) -> None:
        now = time.monotonic()
        numbered = self._ticks.number(self._adapter.feed(data), now)
        for tick, sample in numbered:
            self._rows.append((tick, *sample.codes, sample.status, sample.latency_us, 0))
        if numbered:
            self.times.append((numbered[-1][0], now))

    def host_rate_Hz(self) -> float | None:
        """Sample rate by the host's clock, from the earliest arrivals; None from less than a second."""
        if len(self.times) < 3 or self.times[-1][1] - self.times[0][1] < 1.0:
            return None
        ticks, times = np.array(self.times).T
        return float(np.polyfit(times - times[0], ticks, 1)[0])


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
    if sensor.latency_us is not None and sensor.latency_us.p999 > 1e6 / sensor.sample_rate_Hz:
        reasons.append(
            f"latency of {sensor.latency_us.p999:.0f} µs, more than a sample: lower the rate or raise the baud"
        )
    if stopped or not result.complete:
        return "interrupted", reasons, remarks
    return ("failed" if reasons else "good"), reasons, remarks


def _conclude(folder: Path, adapter: Adapter, stream: _Stream, link: str, note: str | None, stopped: str) -> None:
    capture = RunFolder(folder).capture
    assert capture is not None
    sensor = sensor_figures(capture, adapter.complaints, host_rate_Hz=stream.host_rate_Hz())
    result = Result(
        run=folder.name,
        link=link,
        clock="real",
        seconds=float(capture.t_s[-1] - capture.t_s[0]) if len(capture) else 0.0,
        samples=len(capture),
        lost=lost_samples(capture),
        counters={"crc_errors": adapter.crc_errors, "skipped_bytes": adapter.skipped},
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
