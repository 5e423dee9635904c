"""Which sensor speaks on a line: every known decoder hears the first seconds, at every usual baud rate."""

import time
from collections.abc import Sequence
from contextlib import closing
from typing import Any

from hil.sensors.declared import can_protocols, protocols
from hil.sensors.iio import IioGyro
from hil.sensors.port import FileSource, Port, Source, adapter_called, hear, open_source
from hil.sensors.stream_decoder import StreamDecoder
from hil.wire.errors import LinkClosed, LinkError

WITHIN_S = 5.0
"""A line is told within so long."""

_ENOUGH = 3  # frames with a checksum that fits
_SILENT_S = 2.0
_SHORTEST_S = 0.35  # at one baud rate
_FILE_BYTES = 1 << 20


def usual_bauds() -> list[int]:
    """The baud rates of the declared protocols, those first that are the first of most."""
    order: dict[int, float] = {}
    for protocol in protocols().values():
        for place, baud in enumerate(protocol.bauds):
            order[baud] = order.get(baud, 0.0) + 2.0**-place
    return sorted(order, key=lambda baud: -order[baud])


def recognised(port: Port, link: str) -> Port:
    """The same port with the adapter, and the baud rate, of what speaks there. Raises LinkError that says what was
    heard: nothing, or what is none of the known ones.
    """
    if port.kind == "can":
        return port._replace(adapter=_on_bus(port, link))
    if port.kind == "iio":
        return port._replace(adapter=IioGyro(port.path))
    if port.kind == "replay":
        return port._replace(adapter=_in_file(port, link))
    bauds = [port.baud] if port.baud else usual_bauds()
    begin, heard = time.monotonic(), 0
    for place, baud in enumerate(bauds):
        with closing(open_source(port._replace(baud=baud))) as source:
            left = WITHIN_S - 0.4 - (time.monotonic() - begin)
            found, bytes_ = _listen(source, max(left / (len(bauds) - place), _SHORTEST_S), heard)
        heard += bytes_
        if found is not None:
            return port._replace(adapter=adapter_called(found.name, link), baud=baud)
        if not heard and time.monotonic() - begin >= _SILENT_S:
            raise LinkError(f"{link}: nothing was heard in {_SILENT_S:g} s; check supply and wiring, and that it sends")
        if time.monotonic() - begin > WITHIN_S - _SHORTEST_S:
            break
    raise LinkError(
        f"{link}: {heard} bytes were heard at {len(bauds)} baud rates ({', '.join(map(str, bauds))}), but no frame of "
        f"{', '.join(protocols())}; give ?baud= for another rate, or an adapter of your own"
    )


def _listen(source: Source, seconds: float, heard_before: int) -> tuple[StreamDecoder | None, int]:
    """Who spoke within so long; longer until there is a byte, as a silent line is not one of the wrong rate."""
    decoders = [StreamDecoder(one) for one in protocols().values()]
    begin, heard = time.monotonic(), 0
    while True:
        data = hear(source, 0.05)
        heard += len(data)
        for decoder in decoders if data else ():
            decoder.feed(data)
        spent = time.monotonic() - begin
        if (best := _best(decoders)) is not None and spent >= _SHORTEST_S / 2:
            return best, heard
        if spent >= (seconds if heard or heard_before else _SILENT_S):
            return None, heard


def _best(decoders: Sequence[StreamDecoder]) -> StreamDecoder | None:
    best = max(decoders, key=lambda one: (one.has_rates, one.understood))
    return best if best.frames >= _ENOUGH else None


def _in_file(port: Port, link: str) -> Any:
    decoders = [StreamDecoder(one) for one in protocols().values()]
    heard = 0
    with closing(open_source(port)) as source:
        assert isinstance(source, FileSource)
        try:
            while heard < _FILE_BYTES:
                data = source.receive(0.0)
                heard += len(data)
                for decoder in decoders:
                    decoder.feed(data)
        except LinkClosed:
            pass
    best = _best(decoders)
    if best is None:
        what = "is empty" if not heard else f"no frame of {', '.join(protocols())} in {heard} bytes"
        raise LinkError(f"{link}: {what}; a log of CAN frames goes to hil import --dbc")
    return adapter_called(best.name, link)


def _on_bus(port: Port, link: str) -> Any:
    decoders = [adapter_called(name, link) for name in can_protocols()]
    samples = [0] * len(decoders)
    identifiers: dict[int, int] = {}
    begin = time.monotonic()
    with closing(open_source(port)) as source:
        while time.monotonic() - begin < WITHIN_S - 0.5:
            frames = hear(source, 0.05)
            for frame in frames:
                identifiers[frame.arbitration_id] = identifiers.get(frame.arbitration_id, 0) + 1
            for place, decoder in enumerate(decoders):
                samples[place] += len(decoder.feed(frames)) if decoder is not None else 0
            if max(samples) >= 2 * _ENOUGH:
                best = decoders[samples.index(max(samples))]
                assert best is not None
                return adapter_called(getattr(best, "name", ""), link)
    if not identifiers:
        raise LinkError(f"{link}: no frame in {WITHIN_S - 0.5:g} s; check bit rate, termination and supply")
    shown = ", ".join(f"0x{one:X}" for one in sorted(identifiers)[:8]) + (", …" if len(identifiers) > 8 else "")
    raise LinkError(
        f"{link}: {sum(identifiers.values())} frames of {len(identifiers)} identifiers ({shown}), none of "
        f"{', '.join(can_protocols())}; say what they are by --dbc FILE"
    )
