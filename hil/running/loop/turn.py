"""The turn in C, as Python has it: what it works on is lent to it, and what it has done is taken back.

`Turn.run` is one call: it answers samples until there is something for Python to see to (`hil.running.native.Why`).
The descriptor of a serial line, of a plain UDP link or of a CAN interface is read and written there, and a board in
this process is called there.  Every other link is asked through Python for its bytes; the rest is the same.
"""

import ctypes
import socket
import time
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.core.layout import OUTPUT
from estimator.core.library import LIBRARY as CORE
from estimator.observer import Estimates, Observer
from hil.plugins.plugged import Plugged
from hil.records.layout import Layout
from hil.running.native import (
    LIBRARY,
    MOST_ROWS,
    NONE,
    OBSERVE,
    RECEIVE,
    ROOM,
    ROW,
    SAID,
    SAID_ROOM,
    SEND,
    STEP,
    TRACKS,
    BlocksState,
    CanState,
    Kind,
    ReceiverState,
    TurnState,
    Why,
    payload_sizes,
)
from hil.running.recording.recorder import Track
from hil.running.recording.ring import Ring
from hil.wire.can_format import CanFormat
from hil.wire.codec import unpack
from hil.wire.endpoint import Endpoint
from hil.wire.fd_link import FdLink
from hil.wire.link import Link
from hil.wire.sense import COLUMNS, Sense, SenseRow
from hil.wire.stream import Received

SEEN = 1024
"""Rows that are kept for those who look at each, at most."""


def address_of(function: Any) -> int | None:
    """Of a function of C, or of one that C may call."""
    return ctypes.cast(function, ctypes.c_void_p).value


_SAMPLES = address_of(CORE.estimator_samples)
_STAGED = 256  # rows that wait for a track that is no ring
_ESTIMATES, _COVARIANCES = 1024 + MOST_ROWS, 64  # a block may have one for each of its rows
_ESTIMATES_OF_PLUGIN = 128  # which may end this process: what it has not handed on is lost then
_RECEIVER = ("lost", "repeated", "undecodable", "passed_over", "tick", "run", "run_next")
_DECODER = ("bytes", "frames", "cobs_errors", "short", "crc_errors", "oversize", "dropped_bytes", "skipping")
_CAN_DECODER = ("bytes", "frames", "malformed", "broken")


def kind_of(link: Link) -> Kind:
    """How the turn reads and writes a link: by its descriptor where nobody has put something else in between."""
    from hil.wire.can_link import CanLink
    from hil.wire.inproc import InprocLink
    from hil.wire.udp_link import UdpHost

    replaced = {"receive", "send"} & vars(link).keys()
    if isinstance(link.format, CanFormat):
        return Kind.CAN if isinstance(link, CanLink) and not replaced and _untouched(link, CanLink) else Kind.BYTES
    if isinstance(link, FdLink) and not replaced and _untouched(link, FdLink):
        return Kind.STREAM
    if isinstance(link, InprocLink) and not replaced and _untouched(link, InprocLink) and link.memory is not None:
        return Kind.MEMORY
    if isinstance(link, UdpHost) and not replaced and _untouched(link, UdpHost) and link.plain is not None:
        return Kind.DATAGRAM
    return Kind.BYTES


def _untouched(link: Link, kind: type[Any]) -> bool:
    return all(getattr(type(link), name) is getattr(kind, name) for name in ("receive", "send"))


class Turn:
    """`state` is what C works on; rows of the record go to `tracks`, laid out as `layouts` say.  `bind` is called when
    addresses are to be put into `state`; `blocks` is given where samples are taken in blocks.

    Attributes:
        estimates: called with tick (n,) and estimates of the samples that are recorded.
        covariance: called with tick and covariance (n, n), SI, of each that is recorded.
        seen: called with rows, as many as `state.look_after` asks for at most.
    """

    def __init__(
        self,
        state: TurnState,
        endpoint: Endpoint,
        observer: Observer,
        tracks: Mapping[str, Track],
        layouts: Mapping[str, Layout],
        bind: Callable[[], None],
        blocks: BlocksState | None = None,
    ) -> None:
        self._state = state
        self._endpoint = endpoint
        self._observer = observer
        self._bind_mode = bind
        self._blocks = blocks
        self._tracks = {at: tracks[stem] for at, stem in enumerate(TRACKS) if stem in tracks}
        self._staged = {
            at: np.zeros(_STAGED, layouts[TRACKS[at]].dtype)
            for at, track in self._tracks.items()
            if not isinstance(track, Ring)
        }
        self._receiver = ReceiverState(expected=NONE)
        form = endpoint.link.format
        self._can = CanState(node=form.node) if isinstance(form, CanFormat) else None
        self._rows = np.zeros(4 * MOST_ROWS, ROW)
        self._said = np.zeros(SAID_ROOM, np.uint8)
        self._seen = np.zeros(SEEN + MOST_ROWS, ROW)
        self._leftover = b""  # bytes that a link gave and that found no room
        self._kind = kind_of(endpoint.link)
        self._outputs = OUTPUT.itemsize // 8
        self._kept = np.zeros((_ESTIMATES, 1 + len(observer.x) + len(observer.estimated) + self._outputs))
        self._spreads = np.zeros((_COVARIANCES, 1 + len(observer.estimated) ** 2))
        self._bound: list[Any] | None = None
        self._own: Any = None  # `_step`, or `_observe`, for C
        self._raised: BaseException | None = None
        self.estimates: Callable[[NDArray[np.int64], Estimates], None] = _unheard
        self.covariance: Callable[[int, NDArray[np.float64]], None] = _unheard
        self.seen: Callable[[list[SenseRow]], None] = _unheard

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_bound": None, "_own": None}

    def run(self) -> Why:
        """Answer samples until there is something to see to. Raises what the link raises, or Python within the call."""
        if self._endpoint.rows_kept:
            state = self._state
            rows = self._rows[state.row_at : state.batch.row_count]
            state.fresh = not len(rows)
            self._take_rows(np.concatenate([rows, rows_of(self._endpoint.blocks())]))
        why = Why(self.lent(lambda: LIBRARY.turn_run(ctypes.byref(self._state))))
        if trouble := self._state.link.trouble:
            self._state.link.trouble = 0
            self._endpoint.link.trouble(trouble)  # type: ignore[attr-defined]
        if why is Why.CLOSED:
            raise self._endpoint.link.closed(self._state.link.failure)  # type: ignore[attr-defined]
        return why

    def lent(self, call: Callable[[], Any]) -> Any:
        """What a call of C gives that works on `state`. Raises what Python raised within it."""
        if self._bound is None:
            self._bind()
        self._lend()
        try:
            found = call()
        finally:
            self._take_back()
        if self._raised is not None:
            raised, self._raised = self._raised, None
            self._state.failed = 0
            raise raised
        if self._state.failed and isinstance(self._observer, Plugged):
            raise self._observer.failure()
        return found

    @property
    def row(self) -> SenseRow:
        return row_of(self._rows[self._state.row_at])

    # -- lent and taken back -----------------------------------------------------------------------------------------

    def _bind(self) -> None:
        """Give it the addresses, which hold for the run."""
        state, observer = self._state, self._observer
        arrays = observer.arrays
        actual = arrays.c if arrays.settings["two_covariances"][0] else arrays.p
        state.receiver = ctypes.addressof(self._receiver)
        state.can = 0 if self._can is None else ctypes.addressof(self._can)
        self._bind_mode()
        batch = state.batch
        batch.rows, batch.row_room = self._rows.ctypes.data, len(self._rows)
        batch.said, batch.said_room = self._said.ctypes.data, len(self._said)
        sizes = payload_sizes()
        batch.sizes = ctypes.addressof(sizes)
        state.seen, state.estimates = self._seen.ctypes.data, self._kept.ctypes.data
        state.estimate_room, state.estimate_count = len(self._kept), 0
        state.covariances, state.covariance_room, state.covariance_count = (
            self._spreads.ctypes.data, len(self._spreads), 0,
        )  # fmt: skip
        state.newest, state.state = arrays.rows.ctypes.data, observer.x.ctypes.data
        state.covariance = actual.ctypes.data
        state.queue = arrays.memory["queue"].ctypes.data
        state.states, state.estimated, state.outputs = len(observer.x), len(observer.estimated), self._outputs
        if isinstance(observer, Plugged):
            observer.tell_failure_to(ctypes.addressof(state) + TurnState.failed.offset)
            state.estimate_room = _ESTIMATES_OF_PLUGIN
        types = (ctypes.c_uint8 * len(self._endpoint.tx.types)).from_buffer(self._endpoint.tx.types)
        state.types = ctypes.addressof(types)
        for at, staged in self._staged.items():
            track = state.tracks[at]
            track.rows, track.row_size, track.capacity = staged.ctypes.data, staged.itemsize, len(staged)
        link = state.link
        link.kind = self._kind
        calls = {
            "room": ROOM(self._guarded(self._room)),
            "receive": RECEIVE(self._guarded(self._receive)),
            "send": SEND(self._guarded(self._send)),
        }
        self._own = STEP(self._guarded(self._step)) if self._blocks is None else OBSERVE(self._guarded(self._observe))
        for name, call in calls.items():
            setattr(state if name == "room" else link, name, address_of(call))
        if self._kind is Kind.DATAGRAM:
            self._address()
        self._bound = [arrays, actual, sizes, types, *calls.values()]

    def _address(self) -> None:
        (board, board_port), (group, group_port) = self._endpoint.link.plain  # type: ignore[attr-defined]
        link = self._state.link
        link.peer_ip = int.from_bytes(socket.inet_aton(board), "little")
        link.group_ip = int.from_bytes(socket.inet_aton(group), "little")
        link.peer_port, link.group_port = socket.htons(board_port), socket.htons(group_port)

    def _lend(self) -> None:
        state, rx, receiver = self._state, self._endpoint.rx, self._receiver
        descriptor = self._endpoint.link.fileno()
        state.link.fd = -1 if descriptor is None else descriptor
        if self._kind is Kind.MEMORY:
            state.link.answer, state.link.board = self._endpoint.link.memory  # type: ignore[attr-defined]
            state.link.elsewhere = 1
        state.seq = self._endpoint.tx.seq
        # While the angle is carried on, a tick has more to do than the core; one that was put in its place is asked.
        alone = not self._observer.carries_angle and not {"tick", "observe"} & vars(self._observer).keys()
        if self._blocks is None:
            state.step = self._observer.step if alone else address_of(self._own)
        else:
            self._blocks.observe = _SAMPLES if alone else address_of(self._own)
        state.context = self._observer.core
        state.received_ns = self._endpoint.received_ns
        for at, track in self._tracks.items():
            if isinstance(track, Ring):
                lent, mine = track.lend(), state.tracks[at]
                mine.rows, mine.written, mine.read, mine.dropped, mine.head = lent
                mine.row_size, mine.capacity = track.dtype.itemsize, track.capacity
                mine.waits = track.while_full is not None
        for name in _RECEIVER:
            setattr(receiver, name, getattr(rx, name))
        receiver.expected = NONE if rx.expected is None else rx.expected
        if self._can is not None:
            self._lend_can(self._can)
            return
        for name in _DECODER:
            setattr(receiver, name, getattr(rx.decoder, name))
        rest = rx.decoder.rest  # type: ignore[attr-defined]
        receiver.held = len(rest)
        ctypes.memmove(receiver.rest, rest, len(rest))

    def _take_back(self) -> None:
        """What it has changed, and what it has put down."""
        state, endpoint, receiver = self._state, self._endpoint, self._receiver
        for at, track in self._tracks.items():
            if isinstance(track, Ring):
                track.advance(state.tracks[at].head)
            elif state.tracks[at].head:
                self._unload(at)
        rx = endpoint.rx
        for name in _RECEIVER:
            setattr(rx, name, getattr(receiver, name))
        rx.expected = None if receiver.expected == NONE else receiver.expected
        if self._can is not None:
            self._take_back_can(self._can)
        else:
            for name in _DECODER:
                setattr(rx.decoder, name, getattr(receiver, name))
            rx.decoder.skipping = bool(receiver.skipping)  # type: ignore[attr-defined]
            rx.decoder.rest = bytes(receiver.rest[: receiver.held])  # type: ignore[attr-defined]
        endpoint.tx.seq = state.seq
        if state.drives:
            endpoint.sent_ns = state.sent_ns
        if self._kind is Kind.DATAGRAM:
            endpoint.link.unheard += state.link.strangers  # type: ignore[attr-defined]
            state.link.strangers = 0
        if left := state.link.answered - state.link.taken:
            data = ctypes.string_at(state.link.answers, state.link.answered)[-left:]
            state.link.answered = state.link.taken = 0
            endpoint.link.put_back(data)  # type: ignore[attr-defined]
        self._hear()
        endpoint.received_ns = state.received_ns
        if self._leftover:  # it was received, and nobody else would look there
            data, self._leftover = self._leftover, b""
            endpoint.take_in(rx.feed(data))
        self._tell_estimates()
        if state.seen_count:
            rows = [row_of(row) for row in self._seen[: state.seen_count]]
            state.seen_count = 0
            self.seen(rows)

    def _lend_can(self, can: CanState) -> None:
        decoder: Any = self._endpoint.rx.decoder
        for name in _CAN_DECODER:
            setattr(can, name, getattr(decoder, name))
        can.unfinished = NONE if decoder.unfinished is None else decoder.unfinished[0] << 16 | decoder.unfinished[1]
        can.joined = len(decoder.joined)
        ctypes.memmove(can.parts, decoder.joined, can.joined)

    def _take_back_can(self, can: CanState) -> None:
        decoder: Any = self._endpoint.rx.decoder
        for name in _CAN_DECODER:
            setattr(decoder, name, getattr(can, name))
        decoder.unfinished = None if can.unfinished == NONE else divmod(can.unfinished, 1 << 16)
        decoder.joined = bytes(can.parts[: can.joined])

    def _unload(self, at: int) -> None:
        """Give a track that is no ring what waits for it."""
        track = self._state.tracks[at]
        rows, track.head = self._staged[at][: track.head], 0
        self._tracks[at].push(rows)

    def _hear(self) -> None:
        """Messages beside samples go where `poll` finds them."""
        at, size = 0, self._state.batch.said_size
        if not size:
            return
        self._state.batch.said_size = 0
        said = self._said[:size].tobytes()
        found = []
        while at < size:
            head = np.frombuffer(said, SAID, 1, at)[0]
            at += SAID.itemsize
            length = int(head["size"])
            found.append(
                Received(int(head["tick"]), int(head["seq"]), unpack(int(head["type"]), said[at : at + length]))
            )
            at += -(-length // 8) * 8
        self._endpoint.received_ns = self._state.received_ns
        self._endpoint.take_in(found)

    def _tell_estimates(self) -> None:
        count = self._state.estimate_count
        if not count:
            return
        self._state.estimate_count = 0
        observer, kept = self._observer, self._kept[:count]
        states, estimated = len(observer.x), len(observer.estimated)
        deviations = np.zeros((count, states))
        with np.errstate(invalid="ignore"):
            deviations[:, observer.estimated_index] = np.sqrt(kept[:, 1 + states : 1 + states + estimated])
        rows = np.ascontiguousarray(kept[:, 1 + states + estimated :]).view(OUTPUT)[:, 0]
        ticks = kept[:, 0].astype(np.int64)
        estimates = observer.estimates_of(np.arange(count), kept[:, 1 : 1 + states], deviations, rows)
        self.estimates(ticks, estimates)
        for spread in self._spreads[: self._state.covariance_count]:
            scaled = spread[1:].reshape(len(observer.estimated), -1)
            self.covariance(int(spread[0]), observer.covariance_of(scaled))
        self._state.covariance_count = 0

    def _take_rows(self, rows: NDArray[np.void]) -> None:
        if len(rows) > len(self._rows):
            self._rows = np.zeros(len(rows) + 4 * MOST_ROWS, ROW)
            self._state.batch.rows, self._state.batch.row_room = self._rows.ctypes.data, len(self._rows)
        self._rows[: len(rows)] = rows
        self._state.batch.row_count, self._state.row_at = len(rows), 0

    # -- called from C -----------------------------------------------------------------------------------------------

    def _guarded(self, call: Callable[..., Any]) -> Callable[..., Any]:
        """What it raises is raised again when C has returned: an exception must not pass through it."""

        def guarded(*arguments: Any) -> Any:
            try:
                return call(*arguments)
            except BaseException as error:  # noqa: BLE001 - Ctrl-C as well
                self._raised, self._state.failed = error, 1
                return -1

        return guarded

    def _step(self, _: int, vx: float, vy: float, ux: float, uy: float, codes: Any) -> None:
        codes[0], codes[1] = self._observer.tick(vx, vy, ux, uy)

    def _room(self, at: int) -> int:
        track = self._tracks[at]
        if not isinstance(track, Ring):
            self._unload(at)
            return 1
        track.advance(self._state.tracks[at].head)
        return int(track.room() > 0)

    def _receive(self, timeout_ns: int, to: int, room: int) -> int:
        data = self._leftover or self._endpoint.link.receive(1e-9 * timeout_ns)
        if data:
            self._state.received_ns = self._endpoint.link.arrived_ns or time.monotonic_ns()
        data, self._leftover = data[:room], data[room:]
        self._state.link.elsewhere = bool(self._leftover)
        ctypes.memmove(to, data, len(data))
        return len(data)

    def _send(self, data: int, size: int) -> int:
        self._endpoint.link.send(ctypes.string_at(data, size))
        return 0

    def _observe(self, _: int, n: int, z: int, u: int, outputs: int) -> None:
        rows = _doubles(outputs, n, self._outputs).view(OUTPUT)[:, 0]
        self._observer.observe(_doubles(z, n, 2), _doubles(u, n, 2), rows)


def _doubles(at: int, rows: int, columns: int) -> NDArray[np.float64]:
    """What stands at an address; lent."""
    return np.ctypeslib.as_array(ctypes.cast(at, ctypes.POINTER(ctypes.c_double)), (rows, columns))


def _unheard(*_: Any) -> None:
    """Where nobody listens."""


def rows_of(items: Iterable[Received]) -> NDArray[np.void]:
    """The samples of the SENSE among messages."""
    parts = [np.zeros(0, ROW)]
    for tick, _, sense in items:
        if isinstance(sense, Sense):
            size = len(sense.codes)
            part = np.zeros(size, ROW)
            part["tick"] = np.arange(tick, tick + size)
            for column, name in enumerate(COLUMNS):
                part[name] = sense.codes[:, column]
            part["flags"], part["matrix"] = sense.flags, sense.matrix_id
            part["left"] = np.arange(size, 0, -1)
            parts.append(part)
    return np.concatenate(parts)


def row_of(row: np.void) -> SenseRow:
    """One sample as plain integers."""
    tick, vx, vy, ux, uy, flags, _, _ = row.tolist()
    return tick, vx, vy, ux, uy, flags
