"""The C reader of frames with the face of the Python decoder."""

import ctypes

from hil.wire.framing import MAX_BODY, Frame

from .c_messages import CFrame

COUNTERS = ("frames", "cobs_errors", "too_short", "crc_errors", "oversize")


class _Reader(ctypes.Structure):
    """hil_reader: its counters, and room for what follows them."""

    _fields_ = [(name, ctypes.c_uint32) for name in COUNTERS] + [("rest", ctypes.c_uint64 * 16)]


class CReader:
    """Feeds bytes to the C reader one by one; `room` as for hil_reader_init."""

    def __init__(self, library: ctypes.CDLL, room: int = MAX_BODY) -> None:
        self._library = library
        self._reader = _Reader()
        self._body = (ctypes.c_uint8 * room)()
        self._frame = CFrame()
        self._take = library.hil_reader_take
        self._take.restype = ctypes.c_bool
        self._kept = room - 11
        library.hil_reader_init(ctypes.byref(self._reader), self._body, ctypes.c_size_t(room))

    def feed(self, data: bytes) -> list[Frame]:
        """The intact frames that `data` completes, each with as much payload as there was room for."""
        frames = []
        found = self._frame
        for byte in data:
            if self._take(ctypes.byref(self._reader), ctypes.c_uint8(byte), ctypes.byref(found)):
                payload = ctypes.string_at(found.payload, min(found.size, self._kept))
                frames.append(Frame(found.type, found.seq, found.tick, payload))
                self.size = int(found.size)
        return frames

    @property
    def counters(self) -> dict[str, int]:
        """All counters, by the names of the Python decoder."""
        counted = {name: getattr(self._reader, name) for name in COUNTERS}
        counted["short"] = counted.pop("too_short")
        return counted


def write_frame(library: ctypes.CDLL, frame: Frame) -> list[bytes]:
    """The pieces that the C side writes of a frame."""
    pieces: list[bytes] = []

    def take(_: object, data: int, size: int) -> None:
        pieces.append(ctypes.string_at(data, size))

    callback = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t)(take)
    held = (ctypes.c_uint8 * max(len(frame.payload), 1)).from_buffer_copy(frame.payload or b"\0")
    given = CFrame(frame.type, True, frame.seq, frame.tick, held, len(frame.payload))
    library.hil_frame_write(ctypes.byref(given), callback, None)
    return pieces
