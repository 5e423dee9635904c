"""Frames on a byte stream, the way `FrameFormat` wants them; `hil.wire.framing` does the work."""

from hil.wire.framing import Decoder, encode_frame


class SerialFormat:
    sealed = True

    def encode(self, type_: int, seq: int, tick: int, payload: bytes) -> tuple[bytes, int]:
        return encode_frame(type_, seq, tick, payload), 1

    def cut(self, data: bytes) -> tuple[list[bytes], bytes]:
        *runs, rest = data.split(b"\0")
        return [b"\0" + run + b"\0" for run in runs if run], rest

    def kind(self, frame: bytes) -> int | None:
        return next((found.type for found in Decoder().feed(frame)), None)

    def decoder(self) -> Decoder:
        return Decoder()


SERIAL = SerialFormat()
"""The format of every link that carries bytes."""
