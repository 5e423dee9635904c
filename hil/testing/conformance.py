"""What a package that brings a link, a sensor or a file format has to keep, as classes of tests to inherit.

    from hil.testing.conformance import AdapterConformance

    class TestMyGyro(AdapterConformance):
        make = MyGyro
        stream = recorded_datagrams
        samples = 12

pytest collects what the class inherits.  The bench's own links, adapters and readers run the same classes.
"""

import math
import random
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from estimator.declared_loop import RATE_RAD_S, DeclaredLoop
from estimator.observer import Observer
from hil.bench import load_bench, override
from hil.bench.examples import find
from hil.errors import InputError
from hil.importing.importer import PackagedSource, Reader, import_from
from hil.inputs.declared import board_device_of, controller_settings_of, observer_settings_of
from hil.library.generating import assumed_board
from hil.plugins.of_bench import loop_observer
from hil.plugins.plugged import Plugged
from hil.sensors.adapter import Adapter, Sample
from hil.wire import client
from hil.wire.endpoint import Endpoint
from hil.wire.errors import LinkError
from hil.wire.link import Link
from hil.wire.messages import SafeReason, State

_NOISE = 20_000  # bytes
_LINES = "\r\n"
_ANGLE, _ENERGY = -2, -1
_QUIET = 200


class AdapterConformance:
    """Of `hil.sensors.adapter.Adapter`.

    Attributes:
        make: makes one that has heard nothing.
        stream: bytes as the sensor sends them, from the beginning of a datagram on.
        samples: how many datagrams these are, at least ten.
        size: bytes of a datagram.
        odds: share of damaged datagrams that its checksum may let pass; 1 for a stream without one.
    """

    make: ClassVar[Callable[[], Adapter]]
    stream: ClassVar[bytes]
    samples: ClassVar[int]
    size: ClassVar[int]
    odds: ClassVar[float] = 1e-3

    def test_says_what_it_is(self) -> None:
        adapter = type(self).make()
        assert adapter.title
        assert adapter.channels
        assert all(column.type in ("i4", "f4", "f8") for column in adapter.channels)
        assert adapter.baud > 0
        assert adapter.counter_size > 1
        assert adapter.rates_Hz
        assert all(rate > 0.0 for rate in adapter.rates_Hz)

    def test_decodes_each_datagram_once(self) -> None:
        adapter = type(self).make()
        decoded = adapter.feed(self.stream)
        assert len(decoded) == self.samples >= 10
        for sample in decoded:
            assert len(sample.codes) == len(adapter.channels)
            assert 0 <= sample.counter < adapter.counter_size
            assert isinstance(adapter.complaints(sample.status), list)
        assert adapter.crc_errors == 0

    @pytest.mark.parametrize("piece", [1, 2, 3, 7, 64])
    def test_decodes_the_same_however_the_bytes_come(self, piece: int) -> None:
        adapter = type(self).make()
        parts = [self.stream[at : at + piece] for at in range(0, len(self.stream), piece)]
        assert [one for part in parts for one in adapter.feed(part)] == self._whole()

    def test_finds_the_datagrams_behind_what_is_none(self) -> None:
        adapter = type(self).make()
        begun_within = adapter.feed(self.stream[self.size // 2 :])
        assert begun_within[-(self.samples - 2) :] == self._whole()[-(self.samples - 2) :]

    def test_drops_a_damaged_datagram_and_counts_it(self) -> None:
        if self.odds == 1.0:
            pytest.skip("a stream without a checksum")
        adapter = type(self).make()
        damaged = bytearray(self.stream)
        damaged[self.size * (self.samples // 2) + self.size // 2] ^= 0x10
        decoded = adapter.feed(bytes(damaged))
        assert len(decoded) in (self.samples - 2, self.samples - 1)
        assert [one for one in decoded if one not in self._whole()] == []
        assert adapter.crc_errors > 0

    def test_takes_no_noise_for_a_datagram(self) -> None:
        adapter = type(self).make()
        heard = adapter.feed(random.Random(1).randbytes(_NOISE))
        assert len(heard) <= self.odds * _NOISE / self.size + 1
        adapter.feed(b"\x00" * _NOISE)
        adapter.feed(b"\xff" * _NOISE)
        assert adapter.feed(self.stream)[-(self.samples - 2) :] == self._whole()[-(self.samples - 2) :]

    def _whole(self) -> Sequence[Sample]:
        return type(self).make().feed(self.stream)


class LinkConformance:
    """Of what a scheme opens: the host's end, with a board that speaks the wire behind it.

    Attributes:
        bad: rests of a name that cannot be opened.

    A fixture `place` gives what stands behind the scheme and the colon, with a board there for the length of the test.
    """

    open: ClassVar[Callable[[str], Link]]
    bad: ClassVar[tuple[str, ...]] = ("",)

    def test_leads_to_a_board(self, place: str) -> None:
        with closing(type(self).open(place)) as link:
            endpoint = Endpoint(link)
            identity = client.connect(endpoint, 10.0)
            assert identity.tick_rate_Hz > 0.0
            assert client.make_safe(endpoint, SafeReason.HOST_REQUEST, 10.0).state in (State.IDLE, State.SAFE)

    def test_waits_no_longer_than_it_is_told(self, place: str) -> None:
        with closing(type(self).open(place)) as link:
            begin = time.monotonic()
            assert link.receive(0.05) == b""
            assert 0.0 <= time.monotonic() - begin < 5.0

    def test_has_a_name_and_can_be_closed_twice(self, place: str) -> None:
        link = type(self).open(place)
        assert link.name
        assert link.advice
        link.close()
        link.close()

    def test_is_there_again_for_the_next_host(self, place: str) -> None:
        for _ in range(2):
            with closing(type(self).open(place)) as link:
                assert client.connect(Endpoint(link), 10.0).unique_id

    def test_says_in_one_line_what_it_cannot_open(self) -> None:
        for rest in self.bad:
            with pytest.raises(LinkError) as refusal:
                type(self).open(rest)
            assert not set(_LINES) & set(str(refusal.value))


class ImporterConformance:
    """Of a function from a path to columns.

    Attributes:
        reader: the function.
        suffix: how names of its files end, with the dot.
        content: bytes of a file that has the interchange columns (t_s, vx_V, …).
        rows: how many rows that is.
    """

    reader: ClassVar[Reader]
    suffix: ClassVar[str]
    content: ClassVar[bytes]
    rows: ClassVar[int]

    def test_its_columns_have_one_length(self, tmp_path: Path) -> None:
        columns = type(self).reader(self._file(tmp_path, self.content))
        assert {len(values) for values in columns.values()} == {self.rows}  # type: ignore[arg-type]

    def test_its_file_becomes_a_capture(self, tmp_path: Path) -> None:
        source = PackagedSource(self._file(tmp_path, self.content), type(self).reader)
        assert len(import_from(source, tmp_path / "made.arrow", None).capture) == self.rows

    @pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
    def test_a_file_that_is_cut_is_read_or_refused_in_one_line(self, tmp_path: Path, share: float) -> None:
        place = self._file(tmp_path, self.content[: int(share * len(self.content)) | 1])
        try:
            told = "".join(PackagedSource(place, type(self).reader).names)
        except InputError as refusal:
            told = str(refusal)
        assert told
        assert not set(_LINES) & set(told)

    def _file(self, folder: Path, content: bytes) -> Path:
        place = folder / f"record{self.suffix}"
        place.write_bytes(content)
        return place


class PluginConformance:
    """Of an observer, a controller, or both in one, in the loop of a device as it was declared.

    Attributes:
        observer, controller: names as in a bench file, None where it is no such thing.
        bench: a bench file or example, of a two-axis gyro in force mode.
        samples: how many it is given.
        energy: largest share by which the energy may be off its set point in the last tenth of them.
        turning: largest share by which an observer's angle and rate may be off the turn of the board in the last half.
    """

    observer: ClassVar[str | None] = None
    controller: ClassVar[str | None] = None
    bench: ClassVar[str] = "s-slow"
    samples: ClassVar[int] = 4000
    energy: ClassVar[float] = 0.05
    turning: ClassVar[float] = 0.2

    def test_it_keeps_the_device_in_motion(self) -> None:
        rows = self._rows()
        held = [row[_ENERGY] for row in rows[-self.samples // 10 :]]
        assert max(abs(energy - 1.0) for energy in held) <= self.energy
        assert any(any(row[:2]) for row in rows)

    def test_angle_and_rate_are_the_turn_of_the_board(self) -> None:
        """The device of this loop turns at `RATE_RAD_S`, while the bench's control law imposes a virtual rotation."""
        if self.observer is None:
            return
        observer, _ = self._loop()
        rows = np.array(self._rows()[self.samples // 2 :])
        mean = (rows[-1, _ANGLE] - rows[0, _ANGLE]) / (len(rows) - 1)
        assert mean * observer.device.sample_rate == pytest.approx(RATE_RAD_S, rel=self.turning)
        assert rows[:, 2 + observer.names.index("rate")].mean() == pytest.approx(RATE_RAD_S, rel=self.turning)

    def test_the_same_samples_are_answered_alike(self) -> None:
        assert self._rows() == self._rows()

    def test_instances_share_nothing(self) -> None:
        first, second = self._loop(), self._loop()
        apart = self._rows()
        begun = [self._step(*first, sample) for sample in range(300)]
        beside = [(self._step(*first, sample), self._step(*second, sample - 300)) for sample in range(300, 600)]
        assert begun + [row for row, _ in beside] == apart[:600]
        assert [row for _, row in beside] == apart[:300]

    def test_it_gets_over_samples_that_are_lost(self) -> None:
        rows = self._rows(lost=range(self.samples // 2, self.samples // 2 + 20))
        assert all(math.isfinite(number) for row in rows for number in row)
        assert abs(rows[-1][_ENERGY] - 1.0) <= 2.0 * self.energy

    def test_it_asks_for_nothing_beyond_the_limit(self) -> None:
        """With a fifth of the drive: one that does not know its limit is refused."""
        self._rows(limited=0.2)

    def _loop(self, limited: float = 1.0) -> tuple[Plugged, DeclaredLoop]:
        bench = load_bench(find("bench", self.bench))
        limit = limited * float(bench.drive_limit_mps2)
        changes: dict[str, dict[str, Any]] = {
            "observer": {"plugin": self.observer},
            "controller": {"plugin": self.controller, "force_limit_mps2": limit},
            "loop": {"clock": "lockstep"},
        }
        bench = override(bench, changes, "the conformance test")
        identity = assumed_board(bench, 1, None, None)
        observer = loop_observer(bench, identity)
        assert isinstance(observer, Plugged), "give the name of an observer, or of a controller"
        device = board_device_of(bench), observer_settings_of(bench), controller_settings_of(bench, identity)
        return observer, DeclaredLoop(Observer(*device))

    def _step(self, observer: Plugged, device: DeclaredLoop, sample: int, *, lost: bool = False) -> tuple[float, ...]:
        sense, applied = device.sample()
        observer.enable_control(sample >= _QUIET)
        volts = (math.nan, math.nan) if lost else (float(sense[0]), float(sense[1]))
        codes = observer.tick(*volts, float(applied[0]), float(applied[1]))
        device.answer(codes)
        row = observer.newest
        return (*codes, *observer.state.tolist(), float(row["angle"]), float(row["energy_ratio"]))

    def _rows(self, lost: range = range(0), limited: float = 1.0) -> list[tuple[float, ...]]:
        observer, device = self._loop(limited)
        return [self._step(observer, device, sample, lost=sample in lost) for sample in range(self.samples)]
