"""The C board in this process, with the face of the Python one: `exchange(data) -> bytes`, in lockstep.

Its mass is a made-up sequence of sense codes: what is looked at here is what the board makes of them.
"""

import ctypes
from collections.abc import Callable
from typing import Any, Literal

from hil.wire.can_format import BRS, FDF, HEAD, RECORD_SIZE
from hil.wire.messages import ClockMode, SafeReason
from hil.wire.spec import SPEC

from .c_messages import CFrame, struct_of

_HAS_ROOM = ctypes.CFUNCTYPE(ctypes.c_size_t, ctypes.c_void_p)
_WRITE = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t)
_NOW = ctypes.CFUNCTYPE(ctypes.c_uint64, ctypes.c_void_p)
_LOCK = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_bool)


class CanFrame(ctypes.Structure):
    """hil_can_frame."""

    _fields_ = [
        ("identifier", ctypes.c_uint16),
        ("fd", ctypes.c_bool),
        ("length", ctypes.c_uint8),
        ("data", ctypes.c_uint8 * 64),
    ]

    def record(self) -> bytes:
        """As `hil.wire.can_format` has it."""
        head = HEAD.pack(self.identifier, self.length, BRS | FDF if self.fd else 0)
        return (head + bytes(self.data[: self.length])).ljust(RECORD_SIZE, b"\0")

    @classmethod
    def of(cls, record: bytes) -> "CanFrame":
        """From a record."""
        identifier, length, flags = HEAD.unpack_from(record)
        return cls(identifier, bool(flags & FDF), length, (ctypes.c_uint8 * 64)(*record[HEAD.size : HEAD.size + 64]))


_PUT = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.POINTER(CanFrame))


class _Drive(ctypes.Structure):
    _fields_ = [("ux", ctypes.c_int32), ("uy", ctypes.c_int32)]


class _Estimator(ctypes.Structure):
    """hil_estimator."""

    _fields_ = [
        ("start", ctypes.c_void_p),
        ("step", ctypes.c_void_p),
        ("read", ctypes.c_void_p),
        ("context", ctypes.c_void_p),
    ]


_STEP = ctypes.CFUNCTYPE(
    ctypes.c_uint64, ctypes.c_void_p, ctypes.c_int64, ctypes.c_int32, ctypes.c_int32, _Drive, ctypes.c_bool
)
_READ = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)
_PUT_NOW = ctypes.CFUNCTYPE(None, ctypes.c_void_p, _Drive)


class _Config(ctypes.Structure):
    """hil_config."""

    _fields_ = [
        ("identity", struct_of(SPEC.messages["IDENTITY"])),
        ("clocks", ctypes.c_uint),
        ("link", ctypes.c_void_p),
        ("blocks", ctypes.c_void_p),
        ("blocks_size", ctypes.c_size_t),
        ("now_ns", _NOW),
        ("lock", _LOCK),
        ("put_now", _PUT_NOW),
        ("context", ctypes.c_void_p),
        ("estimator", ctypes.c_void_p),
        ("trims", ctypes.c_void_p),
        ("trim_count", ctypes.c_uint),
        ("put_trim", ctypes.c_void_p),
    ]


class CBoard:
    """A board on the serial link or on node `node` of CAN.

    Attributes:
        room: what the link says it could take: bytes, or CAN frames.
        said: what it has sent; `exchange` empties it.
        put: drives that it put out between ticks.
        locks: whether the sample interrupt is masked now; every call of the library must leave it as it was.
    """

    def __init__(
        self,
        library: ctypes.CDLL,
        kind: Literal["serial", "can"] = "serial",
        *,
        node: int = 0,
        latency: int = 1,
        bits: int = 16,
        rows: int = 682,
        estimator: Callable[[int, int], None] | None = None,
    ) -> None:
        self._c = library
        self._kind = kind
        self.room = 1 << 20
        self.said = b""
        self.put: list[tuple[int, int]] = []
        self.locked = False
        self.unlocked = 0
        self._sampled = 0
        self._board = (ctypes.c_uint64 * 2048)()
        self._link = (ctypes.c_uint64 * 256)()
        self._blocks = (ctypes.c_uint8 * (2 * (5 + rows * 4 * (2 if bits <= 16 else 3))))()
        self._keep: list[Any] = [_HAS_ROOM(lambda _: self.room), _NOW(self._now), _LOCK(self._lock)]
        if kind == "serial":
            self._keep.append(_WRITE(self._write))
            library.hil_serial_init(self._link, self._keep[0], self._keep[3], None)
        else:
            self._keep.append(_PUT(self._put))
            library.hil_can_init(self._link, ctypes.c_uint8(node), self._keep[0], self._keep[3], None)
        config = _Config()
        config.identity.tick_rate_Hz = 4000.0
        config.identity.axes = 2
        config.identity.sense_bits = config.identity.drive_bits = bits
        config.identity.latency_ticks = latency
        config.clocks = 1 << ClockMode.LOCKSTEP | 1 << ClockMode.PACED
        config.link = self._link_address()
        config.blocks = ctypes.addressof(self._blocks)
        config.blocks_size = ctypes.sizeof(self._blocks)
        self._keep.append(_PUT_NOW(lambda _, codes: self.put.append((codes.ux, codes.uy))))
        config.now_ns, config.lock = self._keep[1:3]
        config.put_now = self._keep[-1]
        if estimator is not None:  # one that asks for no drive, and says what it is told to
            self._keep += [_STEP(lambda *_: 0), _READ(estimator)]
            step, read = (ctypes.cast(one, ctypes.c_void_p) for one in self._keep[-2:])
            self._keep.append(_Estimator(None, step, read, None))
            config.estimator = ctypes.addressof(self._keep[-1])
        library.hil_board_init.restype = ctypes.c_bool
        library.hil_board_may_go_on.restype = ctypes.c_bool
        library.hil_board_streaming.restype = ctypes.c_bool
        library.hil_board_drive.restype = _Drive
        self.works: bool = library.hil_board_init(self._board, ctypes.byref(config))

    def exchange(self, data: bytes) -> bytes:
        """Take the host's bytes; return what the board says to them, in lockstep including the next SENSE."""
        self.hear(data)
        while self._c.hil_board_may_go_on(self._board):
            self.tick()
        self.poll()
        said, self.said = self.said, b""
        return said

    @property
    def streaming(self) -> bool:
        """Whether SENSE is due at every tick."""
        return bool(self._c.hil_board_streaming(self._board))

    @property
    def state(self) -> int:
        """State as in STATUS."""
        self._c.hil_board_state.restype = ctypes.c_uint8
        return int(self._c.hil_board_state(self._board))

    def hear(self, data: bytes) -> None:
        """Take the host's bytes, and answer."""
        if self._kind == "serial":
            held = ctypes.create_string_buffer(data, len(data))
            self._c.hil_serial_receive(self._link, self._board, held, ctypes.c_size_t(len(data)))
            return
        for at in range(0, len(data), RECORD_SIZE):
            frame = CanFrame.of(data[at : at + RECORD_SIZE])
            self._c.hil_can_receive(self._link, self._board, ctypes.byref(frame))

    def tick(self) -> tuple[int, int]:
        """One tick, and the drive codes held before it."""
        drive = self._c.hil_board_drive(self._board)
        self._sampled += 1
        x, y = 9001 * self._sampled % 20011 - 10005, 7001 * self._sampled % 20023 - 10011
        self._c.hil_board_sample(self._board, ctypes.c_int32(x), ctypes.c_int32(y), ctypes.c_bool(False))
        return drive.ux, drive.uy

    def fault(self, present: bool) -> None:
        """Have its own protection trip, or its fault be gone."""
        if present:
            self._c.hil_board_safe(self._board, ctypes.c_uint8(SafeReason.FAULT))
        else:
            self._c.hil_board_fault_gone(self._board)

    def hang_up(self) -> None:
        """The host is gone."""
        self._c.hil_board_safe(self._board, ctypes.c_uint8(SafeReason.LINK_LOST))

    def poll(self) -> None:
        """Let it send what is ready."""
        self._c.hil_board_poll(self._board)

    def send(self, type_: int, seq: int, tick: int, payload: bytes) -> bool:
        """Hand a frame to its link."""
        link = ctypes.cast(self._link, ctypes.POINTER(ctypes.c_void_p))
        function = ctypes.CFUNCTYPE(ctypes.c_bool, ctypes.c_void_p, ctypes.POINTER(CFrame))(link[0])
        held = (ctypes.c_uint8 * max(len(payload), 1)).from_buffer_copy(payload or b"\0")
        frame = CFrame(type_, True, seq, tick, held, len(payload))
        return function(ctypes.addressof(self._link), ctypes.byref(frame))

    def _link_address(self) -> int:
        return ctypes.addressof(self._link)

    def _now(self, _: object) -> int:
        return 77

    def _write(self, _: object, data: int, size: int) -> None:
        assert not self.locked
        self.said += ctypes.string_at(data, size)

    def _put(self, _: object, frame: Any) -> None:
        assert not self.locked
        self.said += frame.contents.record()

    def _lock(self, _: object, locked: bool) -> None:
        assert locked != self.locked
        self.locked = locked
        self.unlocked += not locked
