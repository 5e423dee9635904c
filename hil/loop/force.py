"""Force mode: the host answers every sample with a drive.

The order of work in a sample is: receive, observe and control, answer; and only then whatever hangs off the
loop (records, progress, limits), so that none of it stands between a sample and its answer.  In real time there is
a moment of rest in between, in which the answer gets away.
"""

import math
import select
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from estimator.observer import Observer
from hil.bench import Bench
from hil.loop.armed import ArmedBoard
from hil.loop.hindsight import Hindsight
from hil.loop.target import TargetSteps
from hil.loop.tracks import put_covariance
from hil.records.recorder import Track
from hil.wire.endpoint import Endpoint
from hil.wire.errors import ProtocolError
from hil.wire.messages import DriveForce, Identity, SafeReason, SenseFlags
from hil.wire.sense import SenseRow

_RESIDUAL_SAMPLES = 200  # over which the residual is averaged before it may stop the run
_LONG_GAP_S = 0.05  # beyond which the phase of the vibration is taken as lost
_PAUSE = 0.25  # of a sample interval, for the answer to get away


@dataclass
class Counters:
    """What happened in a run, as far as only the loop sees it."""

    samples: int = 0
    lost: int = 0
    stopped: int = 0  # of these: the board was SAFE until it was armed again
    held: int = 0
    clipped: int = 0
    saturated: int = 0
    rearmed: int = 0
    residual_safe: int = 0
    board: dict[str, int] = field(default_factory=dict)


class ForceLoop:
    """One run in force mode with an armed board.

    Attributes:
        counters: kept up to date while the loop runs.
        between: called when something has come that is no sample, or nothing for a while.
        stop: set (from a signal handler) to end the loop after the sample at hand.
    """

    def __init__(
        self,
        endpoint: Endpoint,
        identity: Identity,
        bench: Bench,
        observer: Observer,
        tracks: Mapping[str, Track],
    ) -> None:
        self._endpoint = endpoint
        self._name = endpoint.link.name
        self._observer = observer
        self._capture = tracks["capture"]
        self._innovation = tracks["innovation"]
        self._estimates = tracks["estimates"]
        self._covariance = tracks["covariance"]
        self._timing = tracks["timing"]
        rate = identity.tick_rate_Hz
        self._latency = identity.latency_ticks
        self._every = bench.loop.estimate_every
        self._covariance_every = bench.loop.covariance_stride(rate)
        self._waiting = bench.controller.enabled  # to close the loop
        self._step_target = TargetSteps(observer, bench)
        self._acquired = math.ceil(bench.observer.acquisition_s * rate)
        self._long_gap = max(round(_LONG_GAP_S * rate), 2)
        self._silence_s = bench.link.timeout_s
        lockstep, descriptor = bench.loop.clock == "lockstep", endpoint.link.fileno()
        patient = lockstep and descriptor is not None
        self._board = ArmedBoard(endpoint, DriveForce, self._silence_s, patient=patient)
        self._pause_s = 0.0 if lockstep or descriptor is None else _PAUSE / rate
        self._watched = () if descriptor is None else (descriptor,)
        self._quadrature_limit = bench.limits.quadrature
        self._energy_limit = bench.limits.energy_error
        self._volts = [observer.scaling.sense(axis) for axis in range(2)]
        self._noise = [bench.device.sense.noise_V / abs(volts) for volts in self._volts]
        # Views of the row that every tick fills: picking a field out of a record costs a microsecond.
        self._row = observer.rows[0]
        self._nu, self._s = self._row["nu"], self._row["s"]
        self._residual_limit = bench.limits.residual_safe**2
        self.counters = Counters()
        self.between: Callable[[], None] = lambda: None
        self.stop = False
        self._next: int | None = None
        self._phase_lost = False
        self._hindsight = Hindsight(observer)
        self._echo = 0, 0
        self._residual = 1.0
        self._guarded = 0  # sample from which the residual may stop the run

    def run(self, samples: int, report: Callable[[int], None], report_every: int) -> None:
        """Answer `samples` samples (their ticks, gaps included); `report` is told how many are done.

        Raises LinkClosed when the board hangs up, ProtocolError when it falls silent or will not stay armed.
        """
        observer, endpoint = self._observer, self._endpoint
        observer.enable_control(False)
        self._guarded = self._acquired + _RESIDUAL_SAMPLES
        first: int | None = None
        done = 0
        reported = 0
        while done < samples and not self.stop:
            rows = endpoint.receive_rows(self._silence_s)
            if not rows:
                self._attend()
                continue
            if first is None:
                first = rows[0][0]
            newest = rows[-1][0]
            for row in rows:
                tick = row[0]
                if self._next is not None and tick != self._next:
                    self._bridge(tick)
                if self._waiting and tick - first >= self._acquired:
                    self._waiting = False
                    observer.enable_control(True)
                self._step_target(tick - first)
                codes = observer.tick(row[1], row[2], row[3], row[4])
                estimated_ns = time.monotonic_ns()
                if tick == newest:
                    endpoint.send_drive(codes[0], codes[1], tick + self._latency)
                    self._timing.put(tick, endpoint.received_ns, estimated_ns, endpoint.sent_ns)
                    self._give_way()
                else:
                    observer.withdraw()
                self._keep(row, first)
                self._hindsight.saw(row)
                self._echo = row[3], row[4]
                self._next = tick + 1
            self._phase_lost = False
            done = newest - first + 1
            if done - reported >= report_every:
                reported = done
                report(done)

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
            counters.held += bool(flags & SenseFlags.HELD)
            counters.clipped += bool(flags & SenseFlags.CLIPPED)
            counters.saturated += bool(flags & SenseFlags.SATURATED)
        self._capture.put(tick, vx, vy, ux, uy, flags)
        nu_x, nu_y = self._nu.tolist()
        s_x, s_y = self._s.tolist()
        x_volts, y_volts = self._volts
        self._innovation.put(
            tick, nu_x * x_volts, nu_y * y_volts, math.sqrt(s_x) * abs(x_volts), math.sqrt(s_y) * abs(y_volts)
        )
        since = tick - first
        if since % self._every == self._every - 1:
            state, deviation = self._observer.reading()
            out = self._row
            energy, quadrature = float(out["energy_ratio"]), float(out["quadrature_ratio"])
            valid = abs(quadrature) <= self._quadrature_limit and abs(energy - 1.0) <= self._energy_limit
            self._estimates.put(
                tick, *state, *deviation, float(out["angle"]), float(out["angle_pattern"]),
                float(out["angle_plain"]), float(out["angle_rate_integral"]), energy, quadrature, valid,
            )  # fmt: skip
            if since % self._covariance_every == self._covariance_every - 1:
                put_covariance(self._covariance, tick, self._observer)
        self._residual += (
            0.5 * ((nu_x / self._noise[0]) ** 2 + (nu_y / self._noise[1]) ** 2) - self._residual
        ) / _RESIDUAL_SAMPLES
        within = self._residual <= self._residual_limit  # which NaN is not
        if since >= self._guarded and not within:
            self.counters.residual_safe += 1
            self.stop = True

    def _bridge(self, tick: int) -> None:
        """Predict over samples that never came, with the drive the board was last told to apply."""
        assert self._next is not None
        missing = tick - self._next
        if missing < 0:
            raise ProtocolError(
                f"{self._name}: the board's tick went back from {self._next - 1} to {tick}; did it restart?"
            )
        self.counters.lost += missing
        self.counters.stopped += missing if self._phase_lost else 0
        if missing > self._long_gap or self._phase_lost:
            self._hindsight.forget()
            self._observer.lose_phase(missing)
            self._guarded = self.counters.samples + self.counters.lost + _RESIDUAL_SAMPLES
            self._residual = 1.0
            return
        if missing == 1:
            self._hindsight.gap(*self._echo)
        for _ in range(missing):
            ux, uy = self._observer.expected_drive()
            self._observer.tick(math.nan, math.nan, ux, uy)
            self._observer.withdraw()

    def _attend(self) -> None:
        """No sample came: see to the board."""
        if self._board.attend(self._board.heard()):
            self.counters.rearmed += 1
            self._phase_lost = True
        self.between()

    def finish(self, reason: SafeReason) -> None:
        """SAFE, and the board's own counters."""
        self.counters.board = self._board.farewell(reason)
