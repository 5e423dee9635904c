"""A rate table or a climatic chamber of a campaign: reached by VISA, brought to a target, watched, brought to rest.

PyVISA speaks to what answers commands in text: SCPI over TCP, USB or GPIB, and plain serial lines. It is an optional
extra, `gyrohil[instruments]`.
"""

import math
import re
import threading
import time
from types import TracebackType
from typing import Annotated, Any, ClassVar, Self

from pydantic import Field, model_validator

from hil.bench.section import NotNegative, Positive, Section
from hil.errors import InputError

_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_POLL_S = 0.25
_REST_S = 10.0  # for a table to come to rest, beside what its own time-out gives
Text = Annotated[str, Field(min_length=1, max_length=200)]


class Instrument(Section):
    """How an instrument is reached and told what to do."""

    quantity: ClassVar[str] = ""
    """Key of [[vary]] that holds its targets."""

    resource: Text
    """VISA resource: TCPIP::192.168.0.5::INSTR, ASRL/dev/ttyUSB0::INSTR, USB0::…::INSTR"""
    backend: Annotated[str, Field(max_length=500)] = "@py"
    """of PyVISA: @py is PyVISA-py, FILE@sim simulates what a file describes"""
    set: Text
    """command that sets a target, with {target} in it: "RATE {target:.4f}" """
    read: Text
    """query that is answered with the actual value, the first number in the answer"""
    begin: Text | None = None
    """command before all others, as to switch it on"""
    rest: Text | None = None
    """command that brings it to rest; without it `set` with 0 for a table, nothing for a chamber"""
    baud_rate: Annotated[int, Field(gt=0)] | None = None
    """of a serial line"""
    terminator: Annotated[str, Field(min_length=1, max_length=2)] = "\n"
    """end of each command and answer"""
    tolerance: Positive
    """how far from its target the actual value may be, in the unit of the target"""
    dwell_s: NotNegative = 0.0
    """soak time: how long it has to stay within the tolerance before a run"""
    timeout_s: Positive = 60.0
    """how long it may take until then, soak time included"""
    limit: Positive
    """largest magnitude of a target"""

    @model_validator(mode="after")
    def _commands_can_be_made(self) -> Self:
        try:
            made = self.set.format(target=1.5)
        except (KeyError, IndexError, ValueError, AttributeError):
            made = ""
        if not made or made == self.set:
            raise ValueError('set: expected a command with {target} in it, as "RATE {target:.4f}"')
        if self.timeout_s <= self.dwell_s:
            raise ValueError(
                f"timeout_s: {self.timeout_s:g} s is over before dwell_s of {self.dwell_s:g} s is; give more"
            )
        return self

    @property
    def at_rest(self) -> str | None:
        """The command that brings it to rest, if any."""
        return self.rest


class Table(Instrument):
    """A rate table under the gyro. Its targets are `table.rate_dps` in [[vary]] or [fixed]; its actual rate is in each
    run's folder, as reference."""

    quantity: ClassVar[str] = "rate_dps"

    @property
    def at_rest(self) -> str:
        return self.rest or self.set.format(target=0.0)


class Chamber(Instrument):
    """A climatic chamber around the gyro, likewise. Its targets are `chamber.temperature_C`."""

    quantity: ClassVar[str] = "temperature_C"


class Opened:
    """An instrument whose session is open. Every answer is asked for by one thread at a time."""

    def __init__(self, name: str, declared: Instrument) -> None:
        """Raises InputError where it cannot be reached."""
        self.name, self.declared = name, declared
        self._lock = threading.Lock()
        self._moved = False
        try:
            import pyvisa
        except ImportError:
            raise InputError(f"[{name}]: PyVISA is not installed; pip install 'gyrohil[instruments]'") from None
        try:
            manager: Any = pyvisa.ResourceManager(declared.backend)
            self._session = manager.open_resource(
                declared.resource,
                read_termination=declared.terminator,
                write_termination=declared.terminator,
                **({} if declared.baud_rate is None else {"baud_rate": declared.baud_rate}),
            )
            if declared.begin is not None:
                self._session.write(declared.begin)
            self.actual()
        except InputError as error:
            raise InputError(f"{error}; check resource, cable and query") from None
        except Exception as error:  # noqa: BLE001 - PyVISA's backends raise what they like
            raise InputError(f"[{name}] resource: {declared.resource}: {_words(error)}; check name and cable") from None

    def actual(self) -> float:
        """The actual value. Raises InputError where there is no answer, or no number in it."""
        with self._lock:
            try:
                answer = str(self._session.query(self.declared.read))
            except Exception as error:  # noqa: BLE001
                raise InputError(f"[{self.name}] read: {self.declared.resource}: {_words(error)}") from None
        found = _NUMBER.search(answer)
        if found is None:
            raise InputError(f"[{self.name}] read: no number in the answer {answer[:40]!r}; correct the query")
        return float(found.group())

    def bring_to(self, target: float) -> None:
        """Set a target and wait until the actual value has stayed there. Raises InputError where it does not."""
        self._moved = True
        self._write(self.declared.set.format(target=target))
        self._settle(target, self.declared.dwell_s, self.declared.timeout_s)

    def to_rest(self) -> str:
        """Bring it to rest where it was moved: "" once its actual value says so, else why it may still move."""
        command = self.declared.at_rest
        if command is None or not self._moved:
            return ""
        try:
            self._write(command)
            if isinstance(self.declared, Table):
                self._settle(0.0, 0.0, max(_REST_S, self.declared.timeout_s))
        except InputError as error:
            return f"the {self.name} may still move: {error}"
        self._moved = False
        return ""

    def close(self) -> None:
        with self._lock:
            self._session.close()

    def _write(self, command: str) -> None:
        with self._lock:
            try:
                self._session.write(command)
            except Exception as error:  # noqa: BLE001
                raise InputError(f"[{self.name}] {self.declared.resource}: {_words(error)}") from None

    def _settle(self, target: float, dwell_s: float, timeout_s: float) -> None:
        end, since = time.monotonic() + timeout_s, math.inf
        while True:
            now, actual = time.monotonic(), self.actual()
            since = min(since, now) if abs(actual - target) <= self.declared.tolerance else math.inf
            if now - since >= dwell_s:
                return
            if now > end:
                raise InputError(
                    f"[{self.name}] timeout_s: {actual:g} after {timeout_s:g} s, expected {target:g} ± "
                    f"{self.declared.tolerance:g} for {dwell_s:g} s"
                )
            time.sleep(_POLL_S)


class Watched:
    """Reads instruments in a thread of its own while a run lasts.

    Attributes:
        rows: host time [ns, monotonic] and the actual value of each instrument, in their order.
        failed: why it stopped reading, "" where it did not.
    """

    def __init__(self, instruments: list[Opened]) -> None:
        self._instruments = instruments
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._read, name="instruments")
        self.rows: list[tuple[float, ...]] = []
        self.failed = ""

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        self._end.set()
        self._thread.join()

    def _read(self) -> None:
        while True:
            try:
                self.rows.append((time.monotonic_ns(), *(one.actual() for one in self._instruments)))
            except InputError as error:
                self.failed = str(error)
                return
            if self._end.wait(_POLL_S):
                return


def _words(error: Exception) -> str:
    return " ".join(str(error).split())[:160] or type(error).__name__
