"""Force mode: the host answers every sample with a drive.

The order of work in a sample is: receive, observe and control, answer; and only then whatever hangs off the
loop (records, progress, limits), so that none of it stands between a sample and its answer.  In real time there is
a moment of rest in between, in which the answer gets away.
"""

import math
import select
import time
from collections.abc import Mapping, Sequence

from estimator.observer import Observer
from hil.bench import Bench
from hil.declared import drive_limit_of
from hil.loop.angle import ReportedAngle
from hil.loop.echo import Echo
from hil.loop.hindsight import Hindsight
from hil.loop.skeleton import RESIDUAL_SAMPLES, Loop
from hil.loop.tracks import ANGLES, put_covariance
from hil.records.recorder import Track
from hil.wire.endpoint import Endpoint
from hil.wire.errors import ProtocolError
from hil.wire.messages import DriveForce, Identity, Message, SenseFlags
from hil.wire.sense import SenseRow

_PAUSE = 0.25  # of a sample interval, for the answer to get away
_NOTHING_WRITTEN: Mapping[str, float] = {}


class ForceLoop(Loop):
    """One run in force mode."""

    def __init__(
        self,
        endpoint: Endpoint,
        identity: Identity,
        bench: Bench,
        observer: Observer,
        tracks: Mapping[str, Track],
        registers: Mapping[str, float] = _NOTHING_WRITTEN,
    ) -> None:
        super().__init__(endpoint, identity, bench, observer, tracks, DriveForce, registers)
        self._capture = tracks["capture"]
        self._innovation = tracks["innovation"]
        self._estimates = tracks["estimates"]
        self._covariance = tracks["covariance"]
        self._timing = tracks["timing"]
        self._latency = identity.latency_ticks
        self._every = bench.loop.estimate_every
        self._covariance_every = bench.loop.covariance_stride(self._rate_Hz)
        descriptor = endpoint.link.fileno()
        self._pause_s = 0.0 if self._lockstep or descriptor is None else _PAUSE / self._rate_Hz
        self._watched = () if descriptor is None else (descriptor,)
        self._reported = ReportedAngle(bench)
        self._cancelled = [observer.names.index(name) for name in ("kxy", "dxx", "dyy", "dxy")]
        self._volts = [observer.scaling.sense(axis) for axis in range(2)]
        self._noise = [bench.device.sense.noise_V / abs(volts) for volts in self._volts]
        # Views of the row that every tick fills: picking a field out of a record costs a microsecond.
        self._row = observer.newest
        self._nu, self._s = self._row["nu"], self._row["s"]
        self._hindsight = Hindsight(observer)
        self._echo = 0, 0
        limit = int(registers.get("DRIVE_LIMIT", drive_limit_of(bench, identity)))
        self._shown = Echo(self._latency, limit)

    def _turn(self) -> int:
        observer, endpoint = self._observer, self._endpoint
        rows = endpoint.receive_rows(self._slice_s)
        if not rows:
            return 0
        first = self._first
        if first is None:
            first = self._first = rows[0][0]
        newest = rows[-1][0]
        # What came with newer rows is answered where that can still act in time; in lockstep no tick passes meanwhile.
        oldest = newest - (0 if self._lockstep else max(self._latency - 1, 0))
        for row in rows:
            tick = row[0]
            if tick != self._next and self._next is not None:
                self._bridge(tick, row[3:5])
            if self._waiting and self._may_close(tick - first):
                self._waiting = False
                observer.enable_control(True)
            self._step_target(tick - first)
            codes = observer.tick(row[1], row[2], row[3], row[4])
            estimated_ns = time.monotonic_ns()
            if tick >= oldest:
                endpoint.send_drive(codes[0], codes[1], tick + self._latency)
                sent_ns = endpoint.sent_ns
                self._drives += 1
                self._timing.put(tick, endpoint.received_ns, estimated_ns, sent_ns)
                if tick == newest:
                    self._give_way()
                self._shown.sent(codes[0], codes[1], tick + self._latency)
                if sent_ns - self._answered_ns > self._suspicious_ns:
                    self._answered(sent_ns)
                self._answered_ns = sent_ns
            else:
                observer.withdraw()
            self._keep(row, first)
            self._hindsight.saw(row)
            self._echo = row[3], row[4]
            self._next = tick + 1
        return newest - first + 1

    def _give_way(self) -> None:
        """Stand still for a moment, unless the next sample is there already.

        A kernel worker of ordinary priority carries the answer away; with two cores it may have to wait for
        ours.  Beside an answer from a bare read and write that cost 0.6 % of the deadlines at 4 kHz.
        """
        if self._pause_s:
            select.select(self._watched, (), (), self._pause_s)

    def _keep(self, row: SenseRow, first: int) -> None:
        """Everything that hangs off a sample once it is answered."""
        tick, vx, vy, ux, uy, flags = row
        counters = self.counters
        counters.samples += 1
        if flags:
            if flags & SenseFlags.HELD:
                counters.held += 1
                self._board.account.held(tick)
            counters.clipped += bool(flags & SenseFlags.CLIPPED)
            counters.saturated += bool(flags & SenseFlags.SATURATED)
        self._capture.put(tick, vx, vy, ux, uy, flags)
        if not self._stale(tick) and (wrong := self._shown.saw(tick, ux, uy, flags)):
            raise ProtocolError(f"{self._name}: {wrong}; correct its firmware")
        nu_x, nu_y = self._nu.tolist()
        s_x, s_y = self._s.tolist()
        x_volts, y_volts = self._volts
        self._innovation.put(tick, nu_x * x_volts, nu_y * y_volts, _root(s_x) * abs(x_volts), _root(s_y) * abs(y_volts))
        since = tick - first
        if since % self._every == self._every - 1:
            state, deviation = self._observer.reading()
            out = self._row
            energy, quadrature = float(out["energy_ratio"]), float(out["quadrature_ratio"])
            begun = [float(out[name]) for name in ANGLES]
            sd = math.sqrt(max(float(out["angle_variance"]), 0.0))
            kxy, dxx, dyy, dxy = (state[place] for place in self._cancelled)
            counted, u = self._reported.follow(tick / self._rate_Hz, begun, sd, kxy, (dxx, dyy, dxy))
            angle, *others = counted
            if self._reported.kind == "none":
                angle = sd = u = math.nan
            self._estimates.put(
                tick, *state, *deviation, angle, u, sd, *others, energy, quadrature,
                self._reported.valid(energy, quadrature),
            )  # fmt: skip
            if since % self._covariance_every == self._covariance_every - 1:
                put_covariance(self._covariance, tick, self._observer)
        x, y = nu_x / self._noise[0], nu_y / self._noise[1]
        residual = 0.5 * (x * x + y * y)  # not **, which refuses what overflows
        self._judge(residual, 1.0 / RESIDUAL_SAMPLES, since)
        if self._opening is not None:
            self._look((row,))

    def _predict(self, missing: int, drive: Sequence[int]) -> bool:
        """With the drive the board was last told to apply; of a single interval the samples that follow decide."""
        if missing == 1:
            self._hindsight.gap(*self._echo)
        for _ in range(missing):
            ux, uy = self._observer.expected_drive()
            self._observer.tick(math.nan, math.nan, ux, uy)
            self._observer.withdraw()
        return missing == 1 or [round(code) for code in self._observer.expected_drive()] == list(drive)

    def _forget(self) -> None:
        self._hindsight.forget()

    def _begin_again(self) -> None:
        self._shown.forget()

    def _said(self) -> list[Message]:
        return self._endpoint.said()

    def _heed(self, said: list[Message], newest_ns: int) -> None:
        super()._heed(said, newest_ns)
        if self._board.running is not None:
            self._shown.runs(self._board.running)


def _root(variance: float) -> float:
    """Standard deviation; NaN of what is no variance, as an observer that diverged may have it."""
    return math.sqrt(variance) if variance >= 0.0 else math.nan
