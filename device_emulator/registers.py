"""The board's registers: defaults and limits from the wire's spec, refusals with a reason."""

from collections.abc import Sequence

import numpy as np

from device_emulator.trim import Trim
from hil.wire.messages import ClockMode, LoopMode, NackReason
from hil.wire.spec import SPEC

_BY_ID = {register.id: register for register in SPEC.registers.values() if not register.optional}
TRIMS = [register for name, register in SPEC.registers.items() if name.startswith("TRIM_")]
"""Registers of the trim outputs, in their order."""

_LOOP_MODES = (LoopMode.FORCE, LoopMode.GAIN)


class Refused(Exception):
    """The board refuses a request; `reason` goes into the NACK."""

    def __init__(self, reason: NackReason) -> None:
        super().__init__(reason.name)
        self.reason = reason


class Registers:
    """Values in force, the ones of the inner loop as plain attributes."""

    def __init__(self, clocks: tuple[ClockMode, ...], tick_rate_Hz: float, trims: Sequence[Trim] = ()) -> None:
        self._clocks = clocks
        watchdog = SPEC.registers["WATCHDOG_TICKS"]
        self._watchdog_most = max(watchdog.minimum, min(SPEC.watchdog_s * tick_rate_Hz // 1.0, watchdog.maximum))
        self._values: dict[int, float] = {register.id: register.default for register in _BY_ID.values()}
        self.trims = {register.id: output for output, register in enumerate(TRIMS[: len(trims)])}
        self._codes = {register.id: trim.codes for register, trim in zip(TRIMS, trims, strict=False)}
        self.zero_trims()
        self._values[SPEC.registers["CLOCK_MODE"].id] = clocks[0]
        self._values[watchdog.id] = min(watchdog.default, self._watchdog_most)
        self._unpack()

    def read(self, number: int) -> float:
        """Value of a register. Raises `Refused` when there is none of that number."""
        if number not in self._values:
            raise Refused(NackReason.UNKNOWN_REGISTER)
        return self._values[number]

    def write(self, number: int, value: float, *, settled: bool) -> float:
        """Set a register; returns the value now in force. A `settled` board neither streams nor boots.

        Raises `Refused` if the register is unknown, read-only, not to be touched now, or cannot hold the
        value.
        """
        register = _BY_ID.get(number)
        if register is None:
            raise Refused(NackReason.UNKNOWN_REGISTER)
        if register.access != "rw":
            raise Refused(NackReason.READ_ONLY)
        if not register.accepts(value) or (register.name == "WATCHDOG_TICKS" and value > self._watchdog_most):
            raise Refused(NackReason.OUT_OF_RANGE)
        if not (settled or register.live):
            raise Refused(NackReason.BAD_STATE)
        if register.name == "CLOCK_MODE" and int(value) not in self._clocks:
            raise Refused(NackReason.NOT_SUPPORTED)
        if register.name == "LOOP_MODE" and int(value) not in _LOOP_MODES:
            raise Refused(NackReason.NOT_SUPPORTED)
        self._values[number] = value if register.real else int(value)
        self._unpack()
        return self._values[number]

    def write_trim(self, number: int, code: float, *, streaming: bool) -> int:
        """Set a trim output; returns its code. Raises `Refused` for one out of range, or other than 0 where nothing
        streams."""
        lowest, highest = self._codes[number]
        if not lowest <= code <= highest or code != int(code):
            raise Refused(NackReason.OUT_OF_RANGE)
        if code and not streaming:
            raise Refused(NackReason.BAD_STATE)
        self._values[number] = int(code)
        return int(code)

    def zero_trims(self) -> None:
        """All outputs at 0."""
        self._values |= dict.fromkeys(self.trims, 0)

    @property
    def filter_radius(self) -> float:
        """Spectral radius of the filter's A."""
        return float(np.abs(np.linalg.eigvals(np.array(self.filter_a))).max())

    def _unpack(self) -> None:
        value = {register.name: self._values[register.id] for register in _BY_ID.values()}
        self.lockstep = value["CLOCK_MODE"] == ClockMode.LOCKSTEP
        self.gain_mode = value["LOOP_MODE"] == LoopMode.GAIN
        self.block = int(value["BLOCK"])
        self.watchdog = int(value["WATCHDOG_TICKS"])
        self.drive_limit = int(value["DRIVE_LIMIT"])
        self.status_every = int(value["STATUS_EVERY"])
        self.filter_a = tuple(tuple(value[f"FILTER_A{row}{column}"] for column in (1, 2)) for row in (1, 2))
        self.filter_b, self.filter_c = (tuple(value[f"FILTER_{name}{k}"] for k in (1, 2)) for name in "BC")
        self.filter_delay = int(value["FILTER_DELAY"])
        self.dither_amplitude = int(value["DITHER_AMPLITUDE"])
        self.dither_seed = int(value["DITHER_SEED"])
