"""Trim electrodes while the loop runs: put out, confirmed, told to the observer, recorded; and their slow control.

Before a sample that is due (`due`) the loop calls this.  A code acts from the tick in the header of the board's answer
on; the observer is told of it then, late by some samples, and catches up.  A board that refuses a code, answers by
another one or not at all ends the run, and so does an electrode that does not do to the springs what its coefficients
say (docs/decisions/0008-observer-gains.md).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from estimator.observer import Observer
from estimator.trims import STIFFNESS
from hil.bench import Bench
from hil.running.recording.recorder import Track
from hil.running.safety.trim_outputs import Output
from hil.wire import client
from hil.wire.codec import type_of
from hil.wire.endpoint import Endpoint
from hil.wire.errors import ProtocolError
from hil.wire.messages import Nack, RegisterValue, RegisterWrite
from hil.wire.spec import SPEC

Array = NDArray[np.float64]

_ASKED = 8  # times within [link] timeout_s: lines lose frames
_KNOWN = 1e-3  # of the target stiffness: standard deviation with which the springs must be known
_SURE = 2.0  # standard deviations beyond which something is left
_MEAN = 0.03  # weight of the distance to the target beside split and quadrature
_NEARER = np.array([[1.0, -1.0, 0.0], [0.0, 0.0, 2.0], [_MEAN, _MEAN, 0.0]])  # from xx, yy, xy
_ALLOWED = np.array([1.0, 1.0, 2.0 * _MEAN])
_MISSING, _FLOOR = 0.5, 2e-3  # of the softening, of the target: what the springs may fail to do
_MEMORIES = 3.0  # of the observer, for which they may
_AGAIN = 3.0  # tolerances at which the voltages move again


@dataclass
class _Asked:
    """A code on its way: since which sample of the run, and the numbers of the frames."""

    code: int
    since: int
    numbers: list[int] = field(default_factory=list)

    def refused_by(self, nack: Nack) -> bool:
        return nack.of_type == type_of(RegisterWrite) and nack.of_seq in self.numbers


def nulling(squares: Array, softening: Array, left: Array, most: Array) -> Array:
    """Squared voltages (n,) between 0 and `most` (n,) that take off what is left of the springs' [xx - k, yy - k, xy],
    as near as they can; softening (n, 3) by V², squares (n,) that act already.

    Least squares of the smallest step; what that puts beyond a bound is left there, and the others do the rest.
    """
    a, right = _NEARER @ softening.T, _NEARER @ (left + softening.T @ squares)
    wanted, free = squares.copy(), np.ones(len(squares), bool)
    while np.any(free):
        step = np.linalg.lstsq(a[:, free], right - a @ wanted, rcond=1e-6)[0]
        bounded = np.clip(wanted[free] + step, 0.0, most[free])
        beyond = bounded != wanted[free] + step
        if not np.any(beyond):
            wanted[free] = bounded
            break
        stuck = np.flatnonzero(free)[beyond]
        wanted[stuck] = bounded[beyond]
        free[stuck] = False
    return np.asarray(wanted)


class Trimming:
    """The outputs of one run; `due` is the sample of the run before which it is to be called, None for never."""

    def __init__(
        self, endpoint: Endpoint, bench: Bench, observer: Observer, outputs: Sequence[Output], track: Track | None
    ) -> None:
        rate = bench.device.sample_rate_Hz
        self._endpoint, self._observer, self._outputs, self._track = endpoint, observer, outputs, track
        self._rate_Hz, self._trim = rate, bench.trim
        self._period = max(round(bench.trim.period_s * rate), bench.loop.rows)
        self._patience = max(math.ceil(bench.link.timeout_s * rate), 16 * bench.loop.rows)
        self._distrust = math.ceil(_MEMORIES * bench.memory_s * rate)
        self._softening = np.array([output.electrode.softening for output in outputs]).reshape(-1, 3)
        self._most = np.array([output.most_V**2 for output in outputs])
        self._codes = [0] * len(outputs)
        self._asked: dict[int, _Asked] = {}
        self._acted: dict[int, tuple[int, int]] = {}  # output: code, tick from which it acts; not told yet
        self._begun: tuple[Array, Array] | None = None  # springs and deviations before anything was put out
        self._doubtful: int | None = None  # sample since which the springs do not do what they should
        self._next = 0
        self._still = False
        self._recorded = False
        self.due: int | None = 0 if outputs and bench.trim.control else None

    def __call__(self, since: int, tick: int, *, closed: bool) -> None:
        """See to the outputs before sample `since` of the run, of that tick. Raises ProtocolError as the page says."""
        if self.due is None or since < self.due:
            return
        if not self._recorded:
            self._record(tick, tick)
        self._hear()
        self._tell(tick)
        self._ask_again(since)
        if since >= self._next and not self._asked and not self._acted:
            self._next = since + self._period
            if closed:
                self._control(since)
        self.due = since + 1 if self._asked or self._acted else self._next

    def stopped(self, tick: int) -> None:
        """The board was SAFE: all its outputs are at 0, and begin there when it was armed again."""
        self._asked.clear()
        self._endpoint.answers.clear()  # of before, and of what was asked in SAFE
        self._codes = [0] * len(self._outputs)
        self._acted = dict.fromkeys(range(len(self._outputs)), (0, tick))
        self.due = None if self.due is None else 0

    # -- to and from the board ---------------------------------------------------------------------------------------

    def _put(self, k: int, code: int, since: int) -> None:
        asked = self._asked.setdefault(k, _Asked(code, since))
        asked.numbers.append(self._endpoint.tx.seq)
        self._endpoint.send(RegisterWrite(SPEC.registers[self._outputs[k].register].id, code))

    def _ask_again(self, since: int) -> None:
        for k, asked in self._asked.items():
            waited = since - asked.since
            if waited >= self._patience:
                self._end(k, f"did not answer {asked.code} within {waited / self._rate_Hz:g} s")
            if waited >= len(asked.numbers) * self._patience // _ASKED:
                self._put(k, asked.code, since)

    def _hear(self) -> None:
        answers = self._endpoint.answers
        while answers:
            item = answers.popleft()
            message = item.message
            for k, output in enumerate(self._outputs):
                asked = self._asked.get(k)
                if isinstance(message, RegisterValue) and message.register == SPEC.registers[output.register].id:
                    wanted = self._codes[k] if asked is None else asked.code
                    if message.value != wanted:
                        self._end(k, f"reads {message.value:g} after {wanted} was written")
                    if asked is not None:
                        del self._asked[k]
                        self._codes[k] = asked.code
                        self._acted[k] = asked.code, item.tick
                elif asked is not None and isinstance(message, Nack) and asked.refused_by(message):
                    self._end(k, f"was refused as {asked.code}: {client.nack_name(message.reason)}")

    def _tell(self, tick: int) -> None:
        """Tell the observer of codes that act in the interval that ends with sample `tick`."""
        ready = {k: found for k, found in self._acted.items() if found[1] < tick}
        for k, (code, acted) in ready.items():
            late_s = (tick - 1 - acted) / self._rate_Hz
            self._observer.trims.put(k, code * self._outputs[k].told.scale_V, late_s)
            self._codes[k] = code
            del self._acted[k]
        if ready:
            self._record(tick, max(acted for _, acted in ready.values()))

    def _record(self, tick: int, acted: int) -> None:
        self._recorded = True
        if self._track is not None:
            self._track.put(tick, acted, *self._volts)

    @property
    def _volts(self) -> list[float]:
        return [code * output.told.scale_V for code, output in zip(self._codes, self._outputs, strict=True)]

    def _end(self, k: int, what: str) -> None:
        output = self._outputs[k]
        told = f"trim output {output.told.name!r}, {output.register}, {what}"
        raise ProtocolError(f"{self._endpoint.link.name}: {told}", "check the output and the board's firmware")

    # -- control -----------------------------------------------------------------------------------------------------

    def _control(self, since: int) -> None:
        state, deviations = self._observer.reading()
        places = [self._observer.names.index(name) for name in STIFFNESS]
        springs, sd = np.array(state)[places], np.array(deviations)[places]
        target = self._observer.target_stiffness
        if not (np.all(np.isfinite(springs)) and np.all((sd > 0.0) & (sd < _KNOWN * target))):  # 0: not estimated
            return
        if self._begun is None:
            self._begun = springs, sd
        self._require_response(springs, sd, target, since)
        squares = np.array(self._volts) ** 2
        settling = self._softening.T @ squares - self._observer.trims.softened
        left = springs - settling - target * np.array([1.0, 1.0, 0.0])
        allowed = self._trim.tolerance * target * (_AGAIN if self._still else 1.0)
        sure = np.maximum(_SURE * np.sqrt(_NEARER**2 @ sd**2), allowed * _ALLOWED)
        self._still = bool(np.all(np.abs(_NEARER @ left) < sure))
        if self._still:
            return
        share = -math.expm1(-self._trim.period_s / self._trim.time_constant_s)
        wanted = squares + share * (nulling(squares, self._softening, left, self._most) - squares)
        furthest = self._trim.ramp_V_per_s * self._period / self._rate_Hz
        for k, output in enumerate(self._outputs):
            now = self._volts[k]
            volts = math.copysign(math.sqrt(max(wanted[k], 0.0)), output.most_V)
            code = output.code(min(max(volts, now - furthest), now + furthest))
            if code != self._codes[k]:
                self._put(k, code, since)

    def _require_response(self, springs: Array, sd: Array, target: float, since: int) -> None:
        """The springs have to do what the coefficients say, or the voltages would run to their ends for nothing."""
        assert self._begun is not None
        softened, u = self._observer.trims.softened, self._observer.trims.softened_u
        missing = np.abs(springs - self._begun[0] + softened)
        allowed = (
            np.maximum(_MISSING * np.abs(softened), 2.0 * u) + 4.0 * np.hypot(sd, self._begun[1]) + _FLOOR * target
        )
        if np.all(missing <= allowed):
            self._doubtful = None
            return
        self._doubtful = since if self._doubtful is None else self._doubtful
        if since - self._doubtful >= self._distrust:
            entry = int(np.argmax(missing - allowed))
            blamed = int(np.argmax(np.abs(self._softening[:, entry]) * np.array(self._volts) ** 2))
            self._end(
                blamed,
                f"is at {self._volts[blamed]:.3g} V, and {STIFFNESS[entry]} has not moved as "
                f"[trim] softening_N_per_m_per_V2 says ({softened[entry] / target:.2%} of the target expected, "
                f"{missing[entry] / target:.2%} of it missing)",
            )
