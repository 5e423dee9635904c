"""A board as its acceptance tests see it: a conversation, and whole runs of the bench."""

import time
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, NamedTuple, Unpack, cast, get_type_hints

import hil
from hil.bench import Bench, override
from hil.boards.emulation import is_emulated, served
from hil.errors import InputError
from hil.importing.options import ImportOptions
from hil.library.keywords import takes
from hil.library.loading import Trace
from hil.library.verbs import trace
from hil.progress import untold
from hil.records.capture import Capture, read_capture
from hil.records.result import Result
from hil.records.runfolder import RunFolder
from hil.records.runs import named
from hil.replaying.options import ReplayOptions
from hil.running.options import LocalRunOptions
from hil.sensors.options import RecordOptions
from hil.sensors.port import find_port
from hil.tracing.options import TraceOptions
from hil.wire import client
from hil.wire.endpoint import Endpoint
from hil.wire.errors import WireError
from hil.wire.links import open_link
from hil.wire.messages import Capabilities, ClockMode, Identity, Message, SafeReason, Status

_SETTLE = 0.4  # of a run shorter than the bench file's, where the test does not say
_CLOCKS = {"lockstep": Capabilities.LOCKSTEP, "paced": Capabilities.PACED}


class CannotDo(Exception):
    """This board, or this session, cannot do what a test asks for; the plugin skips the test with the reason."""


class Run(NamedTuple):
    """What came of a run: its folder (capture, estimates, innovation) and its figures."""

    folder: RunFolder
    result: Result


class BoardUnderTest:
    """The board at one link. It is connected when first talked to; a run of the bench has the link to itself.

    Attributes:
        bench, link: as given to the session.
        emulated: whether the link starts its own board.
        made: folders of its runs and traces, in order.
    """

    def __init__(self, bench: Bench, link: str, runs: Path, *, may_arm: bool, clock: str | None = None) -> None:
        self.bench, self.link, self.emulated = bench, link, is_emulated(link)
        self.made: list[Path] = []
        self._runs, self._may_arm, self._clock = runs, may_arm, clock
        self._open = ExitStack()
        self._conversation: tuple[Endpoint, Identity] | None = None

    @property
    def endpoint(self) -> Endpoint:
        """The conversation, for messages that have no method here. Raises WireError when nobody answers."""
        return self._connected()[0]

    @property
    def identity(self) -> Identity:
        """Who the board says it is."""
        return self._connected()[1]

    def read(self, register: str) -> float:
        """Value of a register."""
        return client.read_register(self.endpoint, register, self._patience_s)

    def write(self, register: str, value: float) -> float:
        """Set a register; returns the value in force. ProtocolError if the board refuses."""
        return client.write_register(self.endpoint, register, value, self._patience_s)

    def use_clock(self, name: str) -> None:
        """Set CLOCK_MODE: `lockstep`, `paced` or `real`."""
        self.write("CLOCK_MODE", ClockMode[name.upper()])

    def arm(self) -> Status:
        """Arm the board: SENSE streams from now on. Raises CannotDo without consent.

        Consent was given anew, so HELLO opens a new session first: it lifts the latch of a stop before.
        """
        self._require_consent()
        client.connect(self.endpoint, self._patience_s)
        return client.arm(self.endpoint, self._patience_s)

    def safe(self) -> Status:
        """Bring the board to SAFE; its state and counters."""
        return client.make_safe(self.endpoint, SafeReason.HOST_REQUEST, self._patience_s)

    def listen(self, seconds: float) -> list[Message]:
        """Everything the board says within so many seconds."""
        heard: list[Message] = []
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            heard += [item.message for item in self.endpoint.poll(left)]
        return heard

    def require_clock(self, name: str) -> None:
        """Raises CannotDo where the board does not keep this clock."""
        if not self._keeps(name):
            raise CannotDo(f"{self.link}: this board does not keep the clock {name!r}")

    def run(self, *, truth: bool = False, **given: Any) -> Run:
        """Run the bench with the options of `hil.run` and with keys of `[loop]` changed (`duration_s=3.0`); with
        `truth` score it on an emulated board.

        Raises CannotDo without consent to arm, or for `truth` of a board that is not emulated here; InputError and
        WireError as `hil.run`.
        """
        from hil.running.request import request_of
        from hil.running.run import run
        from hil.scoring.score import score

        self._require_consent()
        if truth and not self.emulated:
            raise CannotDo(f"{self.link}: no truth to compare with")
        clock = str(given.get("clock") or self._clock or self.bench.loop.clock)
        if not self._keeps(clock):
            clock = next((name for name in ("lockstep", "paced", "real") if self._keeps(name)), clock)
        options = {name: given.pop(name) for name in get_type_hints(LocalRunOptions) if name in given}
        length_s = float(options.get("duration_s") or self.bench.loop.duration_s)
        settle_s = min(self.bench.loop.settle_s, _SETTLE * length_s)
        bench = override(self.bench, {"loop": {"settle_s": settle_s, **given}}, "the test")
        self.close()
        truth_file = self._runs.with_name("truth.arrow") if truth else None
        options |= {"clock": clock, "truth": truth_file, "replace": True}
        request = request_of(bench, cast(LocalRunOptions, options), link=self.link)
        done = run(request, self._runs, progress=untold)
        if done.folder is None:
            raise InputError(f"{self.link}: nothing was recorded")
        self.made.append(done.folder)
        folder = RunFolder(done.folder)
        result = folder.result if truth_file is None else score(done.folder, truth_file)
        if result is None:
            raise InputError(f"{done.folder}: the run left no result")
        return Run(folder, result)

    @takes(TraceOptions)
    def trace(self, run: Run, **options: Unpack[TraceOptions]) -> Trace:
        """What the model lacks on the record of a run, as `hil.trace`."""
        done = trace(run.folder.path, self.bench, out=self._runs, progress=untold, **options)
        self.made.append(done.path)
        return done

    def close(self) -> None:
        """SAFE if it was armed, and let go of the link; the next use connects anew."""
        if self._conversation is not None:
            endpoint, _ = self._conversation
            with suppress(WireError):  # a board that is gone went SAFE by its watchdog
                client.make_safe(endpoint, SafeReason.HOST_REQUEST, self._patience_s)
            self._conversation = None
        self._open.close()

    @property
    def _patience_s(self) -> float:
        return self.bench.link.timeout_s

    def _connected(self) -> tuple[Endpoint, Identity]:
        if self._conversation is None:
            there = self._open.enter_context(served(self.link, seed=self.bench.loop.seed))
            endpoint = Endpoint(open_link(there.url))
            self._open.callback(endpoint.close)
            self._conversation = endpoint, client.connect(endpoint, self._patience_s)
        return self._conversation

    def _keeps(self, clock: str) -> bool:
        able = Capabilities(self.identity.capabilities)
        if clock == "real":
            return not self.emulated and Capabilities.PACED not in able
        return clock in _CLOCKS and _CLOCKS[clock] in able

    def _require_consent(self) -> None:
        if not self._may_arm:
            raise CannotDo(f"{self.link}: arming a board that is not emulated needs --hil-arm")


class RecordUnderTest:
    """A run's folder, a capture, or a file that `hil import` reads.

    Attributes:
        path: the capture.
        bench: the bench file by which it is replayed and traced, None for that of its run.
        made: folders of what was replayed and traced, in order.
    """

    def __init__(self, place: Path, bench: Path | None, aside: Path, **options: Unpack[ImportOptions]) -> None:
        """What is made of it lies below `aside`.  Raises InputError where it cannot be read."""
        self.bench, self.made = bench, list[Path]()
        self._aside = aside
        place = named(place)
        if place.is_dir():
            place = place / "capture.arrow"
        elif place.suffix != ".arrow":
            place = hil.import_record(place, out=aside / f"{place.stem}.arrow", replace=True, **options).path
        self.path = place

    @property
    def capture(self) -> Capture:
        """Its samples."""
        return read_capture(self.path)

    @takes(ReplayOptions)
    def replay(self, **options: Unpack[ReplayOptions]) -> hil.Run:
        """As `hil.replay`."""
        done = hil.replay(self.path, self.bench, out=self._aside / "runs", progress=untold, **options)
        self.made.append(done.path)
        return done

    @takes(TraceOptions)
    def trace(self, **options: Unpack[TraceOptions]) -> hil.Trace:
        """As `hil.trace`."""
        done = hil.trace(self.path, self.bench, out=self._aside / "runs", progress=untold, **options)
        self.made.append(done.path)
        return done


class SensorUnderTest:
    """The sensor at a link `NAME:PATH[?baud=N]`, NAME being that of an adapter; `adapter` decodes its stream,
    `made` has the folders of its recordings."""

    def __init__(self, link: str, runs: Path) -> None:
        """Recordings are made below `runs`.  Raises InputError where there is no such adapter."""
        self.link, self.made = link, list[Path]()
        self.adapter = find_port(link).adapter
        self._runs = runs

    @takes(RecordOptions)
    def record(self, **options: Unpack[RecordOptions]) -> hil.Run:
        """As `hil.record`."""
        done = hil.record(self.link, out=self._runs, progress=untold, **options)
        self.made.append(done.path)
        return done
