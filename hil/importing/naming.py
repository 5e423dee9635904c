"""Which columns of a source are asked for, by a map or by their own names."""

from collections.abc import Sequence
from typing import NamedTuple

from hil.errors import InputError
from hil.importing.channels import CHANNELS, dimension_of, fault_in, near_channel
from hil.importing.demodulated import CARRIER, Carrier, components_fault
from hil.importing.mapping import Addend, RecordMap, Time
from hil.importing.mapping import Source as Entry
from hil.importing.matlab import MatlabSource
from hil.importing.parquet import ParquetSource
from hil.importing.source import ArraySource, Source
from hil.importing.text_source import TextSource

_OURS = ("tick", "flags")
"""Columns of an export: what a record counts and marks by itself."""
_SI = {"V": "V", "amplitude_V": "V", "Hz": "Hz", "N": "N", "mps2": "m/s^2", "rad_s": "rad/s", "C": "degC"}


class Part(NamedTuple):
    """One column of a channel: its position, what errors call it; `unit` of a time, None where it says its own."""

    channel: str
    at: int
    called: str
    source: Entry
    unit: str | None = None
    scale: float = 1.0
    offset: float = 0.0

    @property
    def is_time(self) -> bool:
        """Whether it is the time, or a summand of it."""
        return self.channel == "t_s"


class Asked(NamedTuple):
    """The columns of a record, and names of those that no channel is."""

    parts: Sequence[Part]
    left_out: tuple[str, ...] = ()


def asked_of(source: Source, mapping: RecordMap, carrier: Carrier | None = None) -> Asked:
    """The columns that a map asks for; without [columns] those whose names are channels. `carrier`: of demodulated
    streams.
    """
    if mapping.columns is None:
        return _by_their_names(source, mapping, carrier)
    given = mapping.columns.given()
    if carrier is not None and carrier.hertz is None and CARRIER not in given:
        given[CARRIER] = Entry(column=carrier.column, unit="Hz")
    if carrier is None and mapping.is_demodulated:
        raise InputError(f"{source.called}: the map's columns are of demodulated streams; give --demodulated")
    if carrier is not None and (fault := components_fault(list(given), carrier, needs_time=mapping.needs_time)):
        raise InputError(f"{source.called}: [columns] {fault}")
    parts: list[Part] = []
    for channel, entry in given.items():
        called = f"{entry.column} ({channel})"
        parts.append(Part(channel, _located(source, channel, entry.column), called, entry, *_unit(channel, entry)))
        parts += [_addend(source, addend, entry) for addend in (entry.add if isinstance(entry, Time) else ())]
    return Asked(parts)


def _by_their_names(source: Source, mapping: RecordMap, carrier: Carrier | None) -> Asked:
    names = [name.removeprefix("capture.") if isinstance(source, MatlabSource) else name for name in source.names]
    if isinstance(source, MatlabSource) and not set(names) & set(CHANNELS):
        raise InputError(f"{source.called}: a MATLAB file; give a --map that says which variable is which channel")
    place = f"{source.called}:{source.header_line}" if isinstance(source, TextSource) else source.called
    own = {} if carrier is None or carrier.hertz is not None else {carrier.column: CARRIER}
    wanted = [name for name in names if name not in _OURS]
    if own and carrier is not None:
        source.locate(carrier.column)
    left_out: tuple[str, ...] = ()
    if isinstance(source, ParquetSource | MatlabSource) and carrier is None:  # of many columns some are asked for
        left_out = tuple(name for name in wanted if name not in CHANNELS and near_channel(name) is None)
        wanted = [name for name in wanted if name not in left_out]
    needs_time = mapping.needs_time
    if needs_time and "t_s" not in names and isinstance(source, ArraySource):
        raise InputError(f"{place}: no column t_s; add it, in seconds")
    if carrier is not None:
        fault = components_fault([own.get(name, name) for name in wanted], carrier, needs_time=needs_time)
    else:
        fault = fault_in(wanted, needs_time=needs_time)
    if fault:
        if asked := source.advice(""):
            fault = f"{'the line is one cell' if len(names) == 1 else fault.partition(';')[0]}; {asked}"
        raise InputError(f"{place}: {fault}")
    if mapping.steady and "t_s" in wanted:
        raise InputError(f"{place}: column t_s: steady states have no time; leave it out, by a map with [columns]")
    return Asked([_plain(source, name, names.index(name), own.get(name, name)) for name in wanted], left_out)


def _plain(source: Source, name: str, at: int, channel: str) -> Part:
    """A channel in its own unit."""
    if isinstance(source, MatlabSource):
        at = source.locate(source.names[at])
    unit = "s" if name == "t_s" else _SI[dimension_of(channel)]
    return Part(channel, at, name, Entry(column=name, unit=unit))


def _unit(channel: str, entry: Entry) -> tuple[str | None, float, float]:
    return (entry.unit, entry.scale, entry.offset) if channel == "t_s" else (None, 1.0, 0.0)


def _addend(source: Source, addend: Addend, entry: Entry) -> Part:
    index = _located(source, "t_s", addend.column)
    return Part("t_s", index, f"{addend.column} (t_s)", entry, addend.unit)


def _located(source: Source, channel: str, name: str | int) -> int:
    try:
        return source.locate(name)
    except InputError as error:
        missing = f"no column {name!r};"
        line = str(error)
        raise InputError(line.replace(missing, f"no column {name!r} for {channel};")) from None
