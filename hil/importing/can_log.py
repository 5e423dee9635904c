"""A log of CAN frames (candump, BLF, ASC, MF4, TRC) by a DBC: every rate in it on the time of one of them."""

import gc
import math
import re
import sys
import traceback
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from hil.errors import InputError
from hil.importing.read_back import write_columns
from hil.records.capture import Capture, read_capture
from hil.records.layout import Column
from hil.records.rates import rates_layout
from hil.sensors.can_decoder import CanDecoder, declared_decoder, load_dbc
from hil.sensors.declared import can_protocols

if TYPE_CHECKING:
    import can


_MAGIC = {b"LOGG": ".blf", b"MDF ": ".mf4"}
_MDF_HEADER = 168  # bytes: identification and header block
_FEWEST = 3
_BUNCHED = 0.6  # of the mean distance: a shorter median is of stamps that came in bunches, as through a gateway
_REPEATED = 0.5
_LATE = 3  # stamps in a row that may come late; where the next ones follow so soon, none is missing

Floats = npt.NDArray[np.float64]


class Channel(NamedTuple):
    """A signal of one sender: its column, stamps (n,) s, values (n,) in the DBC's unit."""

    column: Column
    t_s: Floats
    values: Floats


class Log(NamedTuple):
    """The channels by name, frames of the log, and how many of them the DBC has."""

    channels: dict[str, Channel]
    frames: int
    known: int


def is_can_log(path: Path) -> bool:
    """Whether a file is one, by its first bytes; what cannot be read is none."""
    start = _start_of(path)
    return start[:4] in _MAGIC or is_text_of_frames(start.decode("utf-8", errors="replace"))


def _start_of(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(2000)
    except OSError:
        return b""


def import_can_log(path: Path, target: Path, dbc: str, reference: str | None) -> tuple[Capture, int, tuple[str, ...]]:
    """Write the capture; returns it, the frames that were gone through, and remarks. dbc: a path, or the name of a
    declared protocol; reference: the rate that is true. Raises InputError, one line.
    """
    decoder = declared_decoder(dbc) if dbc in can_protocols() else CanDecoder(dbc, dbc, load_dbc(Path(dbc)))
    log = read_log(path, decoder)
    rates = {name: one for name, one in log.channels.items() if one.column.unit == "rad/s" and one.t_s.size >= _FEWEST}
    if not rates:
        raise InputError(f"{path}: {_nothing(log, decoder, dbc)}")
    if reference is not None and reference not in rates:
        if (known := decoder.called.get(reference, "")) not in rates:
            raise InputError(f"{path}: no rate {reference!r} for --reference; it has {', '.join(rates)}")
        reference = known
    leader = max(
        (name for name in rates if name != reference or len(rates) == 1), key=lambda name: rates[name].t_s.size
    )
    said = []
    t_s = rates[leader].t_s
    if is_bunched(t_s, f"{path}: {leader}"):
        apart = f"{1e3 * float(np.median(np.diff(t_s))):.3g} ms apart by median, {1e3 * _mean_step(t_s):.3g} by mean"
        said.append(f"the stamps came in bunches ({apart}): samples are taken as evenly spaced, gaps are not told")
        t_s = np.linspace(t_s[0], t_s[-1], t_s.size)
    tick, rate_Hz = numbered(t_s)
    columns = {name: _on(t_s, one) for name, one in log.channels.items() if one.t_s.size >= _FEWEST}
    said += [] if len(rates) == 1 else [f"on the time of {leader}, the others interpolated"]
    said += slips({name: columns[name] * rates[name].column.scale for name in rates}, reference)
    if reference is not None:
        columns["rate_rad_s"] = columns[reference] * rates[reference].column.scale
    kept = [one.column._replace(name=f"{name}_code") for name, one in log.channels.items() if name in columns]
    kept += [Column("rate_rad_s", "f8", "rad/s")] if reference is not None else []
    device = f"{decoder.title}, log {path.name}"
    layout = rates_layout(kept, tick_rate_Hz=rate_Hz, device=device)
    written: dict[str, Floats] = {column.name: columns[column.name.removesuffix("_code")] for column in kept}
    empty = np.zeros(t_s.size)
    write_columns(target, layout, {**written, "status": empty, "latency_us": empty - 1}, tick)
    return read_capture(target), log.frames, tuple(said)


def read_log(path: Path, decoder: CanDecoder) -> Log:
    """Every signal with a unit, by name, where several senders have it with the sender's address."""
    stamps: dict[tuple[str, int], list[float]] = {}
    values: dict[tuple[str, int], list[float]] = {}
    frames = known = 0
    for frame in _frames(path):
        frames += 1
        decoded = decoder.decoded(frame)
        if decoded is None:
            continue
        known += 1
        for name, value in decoded.values.items():
            key = name.removesuffix("_code"), frame.arbitration_id
            stamps.setdefault(key, []).append(frame.timestamp)
            values.setdefault(key, []).append(value)
    columns = {column.name.removesuffix("_code"): column for column in decoder.channels}
    senders = {name: [one for one in stamps if one[0] == name] for name, _ in stamps}
    channels = {}
    for name, identifier in stamps:
        called = name if len(senders[name]) == 1 else f"{name}_{identifier & 0xFF:02x}"
        order = np.argsort(stamps[name, identifier], kind="stable")
        t_s, said = np.array(stamps[name, identifier])[order], np.array(values[name, identifier])[order]
        channels[called] = Channel(columns[name], t_s, said)
    return Log(channels, frames, known)


def is_bunched(t_s: Floats, called: str) -> bool:
    """Whether stamps (n,) came in bunches. Raises InputError, of what is `called`, where they are no times at all."""
    steps = np.diff(t_s)
    if np.count_nonzero(steps <= 0.0) > _REPEATED * steps.size:
        raise InputError(f"{called}: most of its {t_s.size} stamps repeat, so they are no times; record it with stamps")
    return bool(np.median(steps) < _BUNCHED * _mean_step(t_s))


def _mean_step(t_s: Floats) -> float:
    return float(t_s[-1] - t_s[0]) / max(t_s.size - 1, 1)


def numbered(t_s: Floats) -> tuple[npt.NDArray[np.int64], float]:
    """Numbers of samples from their stamps (n,), whose median distance is one, and the rate of those in a row in Hz."""
    steps = np.diff(t_s)
    step = float(np.median(steps))
    due = t_s.copy()
    for _ in range(_LATE):
        due[:-1] = np.minimum(due[:-1], due[1:] - step)
    passed = np.maximum(np.rint(np.diff(due) / step), 1.0)
    in_a_row = steps[passed == 1.0]
    return np.concatenate([[0], np.cumsum(passed)]).astype(np.int64), 1.0 / float(in_a_row.mean())


def _on(t_s: Floats, channel: Channel) -> Floats:
    if channel.t_s.size == t_s.size and channel.t_s[0] == t_s[0] and channel.t_s[-1] == t_s[-1]:
        return channel.values  # the leader itself, and what comes in the same messages
    return np.interp(t_s, channel.t_s, channel.values)


def _frames(path: Path) -> Any:
    """The frames of a log. Raises InputError where it is none that can be read."""
    import can

    start = _start_of(path)
    kind = _MAGIC.get(start[:4], path.suffix.lower())
    if kind == ".mf4" and (start[8:10] != b"4." or len(start) < _MDF_HEADER):
        raise InputError(f"{path}: no log of CAN frames that can be read: MDF 4 with a whole header is")
    reader: Mapping[str, Any] = {
        ".blf": can.BLFReader, ".asc": can.ASCReader, ".mf4": can.MF4Reader, ".trc": can.TRCReader,
    }  # fmt: skip
    try:
        if kind not in reader:
            yield from text_frames(path)
            return
        with path.open("r" if kind in (".asc", ".trc") else "rb") as file, reader[kind](file) as frames:
            yield from (frame for frame in frames if isinstance(frame, can.Message))
    except NotImplementedError:
        raise InputError(f"{path}: MF4 needs the package asammdf; install gyrohil[mf4]") from None
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    except Exception as error:  # of its readers each has its own
        told = str(error).split("\n")[0][:120]
        _forget(error)
        raise InputError(f"{path}: no log of CAN frames that can be read: {told or type(error).__name__}") from error


def _forget(error: Exception) -> None:
    """Have what the reader made up to its error end here: of asammdf's a half-made file ends with a traceback."""
    hook, sys.unraisablehook = sys.unraisablehook, lambda _: None
    try:
        traceback.clear_frames(error.__traceback__)
        gc.collect()
    finally:
        sys.unraisablehook = hook


def _nothing(log: Log, decoder: CanDecoder, dbc: str) -> str:
    if not log.frames:
        return "no frame in it; give a log that holds some"
    if not log.known:
        shown = ", ".join(f"0x{one:X}" for one in sorted(decoder.unknown)[:6])
        return f"none of its {log.frames} frames is in {dbc}; its identifiers are {shown}"
    return f"no angular rate of {dbc} in it, by the unit of its signals"


_SLIPS = {
    0.5: "half: one bit of the step, or two samples for one",
    2.0: "double: one bit of the step, or a rate for a step of half a second",
    0.25: "a quarter: two bits of the step",
    4.0: "four times: two bits of the step",
    math.pi / 180.0: "π/180: rad/s that are called deg/s",
    180.0 / math.pi: "180/π: deg/s that are called rad/s",
    -1.0: "the sign: an axis the other way about",
}
_NEAR, _ALIKE = 0.04, 0.9
"""How near a ratio is, and from which correlation on two channels are taken for one rate."""
_STILL = 1e-12
"""Of a rate: what it varies by less is rounding."""


def slips(rates: Mapping[str, npt.NDArray[np.float64]], reference: str | None) -> Iterator[str]:
    """A line for each pair of rates (n,) in rad/s on one time that differ by a known factor; against the reference
    alone, where there is one.
    """
    pairs = combinations(rates, 2) if reference is None else ((reference, name) for name in rates if name != reference)
    for first, second in pairs:
        a, b = rates[first] - rates[first].mean(), rates[second] - rates[second].mean()
        size_a, size_b = float(np.std(a)), float(np.std(b))
        still = any(size <= _STILL * np.abs(rates[name]).max() for name, size in ((first, size_a), (second, size_b)))
        if still or abs(likeness := float(np.mean(a * b)) / (size_a * size_b)) < _ALIKE:
            continue
        ratio = math.copysign(size_b / size_a, likeness)
        for factor, words in _SLIPS.items():
            if abs(ratio / factor - 1.0) <= _NEAR:
                whose = "the reference" if reference is not None else "one of the two scales is off"
                yield f"{second} is {ratio:.4g} times {first}: {words} ({whose})"


_LOG = re.compile(r"\s*\((\d+\.\d+)\)\s+\S+\s+([0-9A-Fa-f]{3,8})#(#[0-9A-Fa-f])?((?:[0-9A-Fa-f]{2}\.?)*)")
_SCREEN = re.compile(
    r"\s*(?:\(([^)]*)\)\s+)?\w+\s+(?:[TR]X [-BE ]+\s+)?([0-9A-Fa-f]{3,8})\s+\[(\d+)\]\s+((?:[0-9A-Fa-f]{2}\s*)*)"
)
_CANBOAT = re.compile(
    r"(\d{4}-\d\d-\d\d)[T-](\d\d:\d\d:\d\d[.\d]*)Z?,(\d+),(\d+),(\d+),(\d+),\d+((?:,[0-9A-Fa-f]{2})+)"
)
_GATEWAY = re.compile(r"(\d\d):(\d\d):(\d\d\.\d+) [RT] ([0-9A-Fa-f]{8})((?: [0-9A-Fa-f]{2})+)")
_STANDARD = 3  # hexadecimal digits of an identifier of 11 bits
_TRIED = 200  # lines that say whether it is such a text
_UNTIMED = "times are missing; record with candump -l, or with -ta on the screen"


def text_frames(path: Path) -> "Iterator[can.Message]":
    """The frames of a text; lines that are none, such as comments, are left out. Raises InputError where none is, and
    where they have no times.
    """
    found = 0
    with path.open(encoding="utf-8", errors="replace") as lines:
        for number, line in enumerate(lines, 1):
            frame = _frame(line, f"{path}: line {number}")
            if frame is not None:
                found += 1
                yield frame
            elif not found and number > _TRIED:
                break
    if not found:
        raise InputError(f"{path}: no frame in it that candump, canboat or a logger writes; give a log that holds some")


def is_text_of_frames(start: str) -> bool:
    """Whether the beginning of a text has such a line."""
    lines = start.splitlines()
    return any(
        _LOG.match(line) or _CANBOAT.match(line) or _GATEWAY.match(line) or (_SCREEN.match(line) and "[" in line)
        for line in lines
    )


def _frame(line: str, where: str) -> "can.Message | None":
    if (log := _LOG.match(line)) is not None:
        time, identifier, fd, data = log.groups()
        return _message(float(time), identifier, data.replace(".", ""), is_fd=fd is not None)
    if (raw := _CANBOAT.match(line)) is not None:
        day, time, priority, pgn, source, target, data = raw.groups()
        number = int(pgn) | (int(target) & 0xFF if int(pgn) >> 8 & 0xFF < 240 else 0)
        payload = bytes.fromhex(data.replace(",", ""))
        return _made(
            timestamp=datetime.fromisoformat(f"{day}T{time}").replace(tzinfo=UTC).timestamp(),
            arbitration_id=(int(priority) & 7) << 26 | number << 8 | int(source) & 0xFF, data=payload,
            is_fd=len(payload) > 8,
        )  # fmt: skip
    if (gateway := _GATEWAY.match(line)) is not None:
        hours, minutes, seconds, identifier, data = gateway.groups()
        return _message(3600.0 * int(hours) + 60.0 * int(minutes) + float(seconds), identifier, data)
    if (screen := _SCREEN.match(line)) is not None:
        time, identifier, length, data = screen.groups()
        if int(length) == len(bytes.fromhex(data)):
            try:
                return _message(float(time), identifier, data)
            except (TypeError, ValueError):
                raise InputError(f"{where}: {_UNTIMED}") from None
    return None


def _message(stamp: float, identifier: str, data: str, *, is_fd: bool = False) -> "can.Message":
    is_extended = len(identifier) > _STANDARD
    return _made(timestamp=stamp, arbitration_id=int(identifier, 16), is_extended_id=is_extended,
                 data=bytes.fromhex(data), is_fd=is_fd)  # fmt: skip


def _made(**said: Any) -> "can.Message":
    from can import Message  # with its readers of logs, which take long to load

    return Message(**said, check=False)
