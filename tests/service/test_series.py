"""Windows of long records: exact, from whatever they are read, and refused in words where they cannot be."""

import struct
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from hil.errors import InputError
from hil.records.blocks import read_blocks
from hil.records.capture import import_layout
from hil.records.direct import DirectRecord
from hil.records.frame import Frame
from hil.records.pyramid import SHORT_ROWS, Pyramid, build, level_path
from hil.records.stream import BlockWriter
from hil.service.series import PyramidNeeded, channels, window
from tests.service.records import RATE_HZ, SCALE_MPS2, SCALE_V, layout, rows_at, write

NAMES = ["capture.vx_V", "capture.vy_V", "capture.ux_mps2", "capture.uy_mps2"]
_CODES = {"capture.vx_V": ("vx_code", SCALE_V), "capture.vy_V": ("vy_code", SCALE_V),
          "capture.ux_mps2": ("ux_code", SCALE_MPS2), "capture.uy_mps2": ("uy_code", SCALE_MPS2)}  # fmt: skip


@pytest.fixture(scope="module")
def gapped() -> npt.NDArray[np.int64]:
    """Ticks of a record that is long enough for a pyramid: it begins late, and has a short and a long gap."""
    tick = np.arange(1_234, 2_000_000)
    return tick[((tick < 500_000) | (tick >= 500_007)) & ((tick < 900_000) | (tick >= 1_100_000))]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, gapped: npt.NDArray[np.int64]) -> Path:
    """A run with that record and its pyramid, written along."""
    place = tmp_path_factory.mktemp("long")
    write(place, gapped, pyramid=True)
    return place


def expected(ticks: npt.NDArray[np.int64], name: str, frame: Frame) -> npt.NDArray[np.float32]:
    """(buckets, 2) by a loop over the buckets of `frame`, from the rows themselves."""
    column, scale = _CODES[name]
    step = round(frame.step_s * RATE_HZ)
    values = np.full((frame.low.shape[1], 2), np.nan, np.float32)
    for bucket in range(len(values)):
        begin = (frame.first + bucket) * step
        rows = rows_at(ticks[np.searchsorted(ticks, begin) : np.searchsorted(ticks, begin + step)])
        if rows.size:
            codes = scale * rows[column].astype(float)
            values[bucket] = codes.min(), codes.max()
    return values


@pytest.mark.slow
@pytest.mark.parametrize(
    ("from_s", "to_s", "points"),
    [(None, None, 800), (None, None, 13), (0.0, 30.0, 300), (4.9, 5.1, 777), (4.9999, 5.0002, 800), (9.7, 15.0, 40)],
)
def test_a_window_is_the_rows_lowest_and_highest(
    folder: Path, gapped: npt.NDArray[np.int64], from_s: float | None, to_s: float | None, points: int
) -> None:
    frame = window(folder, NAMES, from_s, to_s, points)
    low_s, high_s = from_s or 0.0, gapped[-1] / RATE_HZ if to_s is None else to_s
    assert frame.low.shape == frame.high.shape
    assert frame.low.shape[1] <= points + 1
    assert frame.begin_s <= max(low_s, gapped[0] / RATE_HZ if from_s is None else low_s)
    assert frame.begin_s + frame.low.shape[1] * frame.step_s >= high_s
    assert frame.begin_s == pytest.approx(frame.first * frame.step_s)
    for row, name in enumerate(NAMES):
        truth = expected(gapped, name, frame)
        np.testing.assert_array_equal(frame.low[row], truth[:, 0])
        np.testing.assert_array_equal(frame.high[row], truth[:, 1])


@pytest.mark.moderate
def test_buckets_are_hardly_longer_than_asked_for(folder: Path) -> None:
    for points in (100, 800, 3_000):
        frame = window(folder, NAMES[:1], points=points)
        assert 0.75 * points <= frame.low.shape[1] <= points + 1


@pytest.mark.moderate
def test_single_samples_are_told_as_they_are(folder: Path, gapped: npt.NDArray[np.int64]) -> None:
    frame = window(folder, NAMES, 4.99995, 5.0001, 800)
    assert frame.step_s == pytest.approx(1 / RATE_HZ)
    there = ~np.isnan(frame.low[0])
    assert not there[frame.low.shape[1] // 2 - 3 :][:1].all() or not there.all()  # the short gap is in it
    np.testing.assert_array_equal(frame.low, frame.high)
    ticks = frame.first + np.flatnonzero(there)
    assert set(ticks) <= set(gapped)
    np.testing.assert_allclose(frame.low[0][there], SCALE_V * rows_at(ticks)["vx_code"], rtol=1e-6)


def test_the_pyramid_is_what_is_read_of_a_long_window(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read: dict[str, int] = {}
    real = DirectRecord.read

    def counted(self: DirectRecord, names: list[str], start: int, stop: int) -> dict[str, npt.NDArray[np.int64]]:
        found = real(self, names, start, stop)
        read[self.path.name] = read.get(self.path.name, 0) + len(next(iter(found.values())))
        return found

    monkeypatch.setattr(DirectRecord, "read", counted)
    window(folder, NAMES[:1], points=800)
    assert read["capture-256.arrow"] > 5_000
    assert read["capture.arrow"] < 200_000  # checks that they belong together, and the place of the first row


@pytest.mark.slow
@pytest.mark.parametrize("ended", [True, False])
def test_made_afterwards_it_is_the_same_to_the_byte(tmp_path: Path, gapped: npt.NDArray[np.int64], ended: bool) -> None:
    along, after = tmp_path / "along", tmp_path / "after"
    write(along, gapped, pyramid=True, ended=ended, piece=3_333)
    told: list[tuple[int, int]] = []
    build(write(after, gapped, pyramid=False, ended=ended), lambda *done: told.append(done))
    assert told[-1] == (gapped.size, gapped.size)
    for width in (256, 16_384):
        one, other = (level_path(place / "pyramid", "capture", width) for place in (along, after))
        first, second = read_blocks(one, "pyramid"), read_blocks(other, "pyramid")
        for name in first.columns:
            np.testing.assert_array_equal(first.columns[name], second.columns[name])
        assert (first.complete, second.complete) == (ended, True)
    frames = [window(place, NAMES, points=700) for place in (along, after)]
    np.testing.assert_array_equal(frames[0].low, frames[1].low)


@pytest.mark.moderate
def test_a_short_record_has_no_pyramid(tmp_path: Path) -> None:
    write(tmp_path, np.arange(SHORT_ROWS), pyramid=True)
    assert [path.name for path in tmp_path.iterdir()] == ["capture.arrow"]
    build(tmp_path / "capture.arrow")
    assert [path.name for path in tmp_path.iterdir()] == ["capture.arrow"]


@pytest.mark.moderate
def test_a_growing_record_is_seen_up_to_its_last_whole_block(tmp_path: Path) -> None:
    ticks = np.arange(1_500_000)
    writer, along = BlockWriter(tmp_path / "capture.arrow", layout()), Pyramid(tmp_path / "capture.arrow", layout())
    for start in range(0, ticks.size, 10_000):
        rows = rows_at(ticks[start : start + 10_000])
        writer.push(rows)
        along.push(rows)
    frame = window(tmp_path, NAMES, points=500)
    seen = ticks.size // layout().block_rows * layout().block_rows
    end_s = frame.begin_s + frame.low.shape[1] * frame.step_s
    assert end_s - frame.step_s < seen / RATE_HZ <= end_s
    truth = expected(ticks[:seen], NAMES[1], frame)
    np.testing.assert_array_equal(frame.low[1], truth[:, 0])
    np.testing.assert_array_equal(frame.high[1], truth[:, 1])
    writer.close()
    along.close()


@pytest.mark.moderate
def test_a_pyramid_of_another_record_is_not_believed(tmp_path: Path, folder: Path) -> None:
    write(tmp_path, np.arange(7_777, 1_500_000), pyramid=False)
    (tmp_path / "pyramid").mkdir()
    for path in (folder / "pyramid").iterdir():
        (tmp_path / "pyramid" / path.name).write_bytes(path.read_bytes())
    frame = window(tmp_path, NAMES[:1], points=50)
    np.testing.assert_array_equal(
        np.stack([frame.low[0], frame.high[0]], 1), expected(np.arange(7_777, 1_500_000), NAMES[0], frame)
    )


@pytest.mark.moderate
def test_a_long_record_without_one_asks_for_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hil.service.series._AT_ONCE", 500_000)
    record = write(tmp_path, np.arange(1_100_000), pyramid=False)
    with pytest.raises(PyramidNeeded) as needed:
        window(tmp_path, NAMES)
    assert needed.value.record == record
    assert window(tmp_path, NAMES, 3.0, 3.001).low.shape[1] == 101  # what is short is read from the rows
    build(record)
    assert window(tmp_path, NAMES).low.shape[1] > 600


@pytest.mark.moderate
def test_a_changed_bit_is_told_and_not_drawn(tmp_path: Path) -> None:
    path = write(tmp_path, np.arange(200_000), pyramid=False)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    with pytest.raises(InputError, match="checksum differs"):
        window(tmp_path, NAMES)
    assert window(tmp_path, NAMES, 0.0, 0.01).low.shape[1] > 100  # elsewhere it is what was written


@pytest.mark.moderate
def test_a_block_in_anothers_place_is_told(tmp_path: Path) -> None:
    path = write(tmp_path, np.arange(200_000), pyramid=False)
    with DirectRecord(path) as record:
        begin, length = record._begin, record._length
    data = bytearray(path.read_bytes())
    one, two = (slice(begin + k * length, begin + (k + 1) * length) for k in (1, 2))
    data[one], data[two] = data[two], data[one]
    path.write_bytes(data)
    with pytest.raises(InputError, match="hil check"):
        window(tmp_path, NAMES)


@pytest.mark.parametrize("cut", [1, 5_000, 300_000, 1_000_003])
def test_a_cut_record_is_seen_as_far_as_it_goes(tmp_path: Path, cut: int) -> None:
    path = write(tmp_path, np.arange(150_000), pyramid=False)
    path.write_bytes(path.read_bytes()[:-cut])
    whole = read_blocks(path, "capture")
    with DirectRecord(path, "capture") as record:
        assert (record.rows, record.complete) == (whole.rows, whole.complete)
        np.testing.assert_array_equal(record.read(["tick"], 0, record.rows)["tick"], whole.columns["tick"])


def test_uneven_time_is_drawn_by_the_time_of_each_row(tmp_path: Path) -> None:
    t_s = 2.0 + np.cumsum(np.where(np.arange(1_000) % 2, 0.001, 0.003))
    made = import_layout(["t_s", "vx_V"], tick_rate_Hz=500.0, uniform=False, hold="zoh", segments={})
    rows = np.zeros(t_s.size, made.dtype)
    rows["tick"], rows["t_s"], rows["vx_V"] = np.arange(t_s.size), t_s, np.sin(t_s)
    with BlockWriter(tmp_path / "capture.arrow", made) as writer:
        writer.push(rows)
    frame = window(tmp_path, ["capture.vx_V"], points=50)
    assert frame.begin_s == pytest.approx(t_s[0])
    edges = frame.begin_s + frame.step_s * np.arange(51)
    for bucket in range(50):
        inside = np.sin(t_s[(t_s >= edges[bucket]) & (t_s < edges[bucket + 1])])
        assert frame.low[0, bucket] == np.float32(inside.min())
        assert frame.high[0, bucket] == np.float32(inside.max())


def test_a_frame_is_packed_as_agreed() -> None:
    low, high = np.array([[1, 2, 3], [4, np.nan, 6]], np.float32), np.array([[7, 8, 9], [10, np.nan, 12]], np.float32)
    data = Frame(1.5, 0.25, 6, low, high).packed(7)
    assert data[:4] == b"GYT1"
    assert struct.unpack_from("<III", data, 4) == (7, 2, 3)
    assert struct.unpack_from("<ddQ", data, 16) == (1.5, 0.25, 6)
    values = np.frombuffer(data, "<f4", offset=40).reshape(2, 3, 2)
    np.testing.assert_array_equal(values[..., 0], low)
    np.testing.assert_array_equal(values[..., 1], high)
    back = Frame.of(data)
    assert (back.id, back.begin_s, back.step_s, back.first) == (7, 1.5, 0.25, 6)
    np.testing.assert_array_equal([back.low, back.high], [low, high])
    with pytest.raises(InputError, match="no frame"):
        Frame.of(b"GYT2" + data[4:])


def test_channels_are_named_as_the_library_names_them(folder: Path, gapped: npt.NDArray[np.int64]) -> None:
    found = channels(folder)
    assert [one.name for one in found] == NAMES
    assert [one.unit for one in found] == ["V", "V", "mps2", "mps2"]
    assert {one.rows for one in found} == {gapped.size}
    assert (found[0].from_s, found[0].to_s) == (gapped[0] / RATE_HZ, gapped[-1] / RATE_HZ)


@pytest.mark.parametrize(
    ("names", "given", "said"),
    [
        (["capture.nothing"], (), "no such channel"),
        (["/etc/passwd"], (), "no such channel"),
        (["capture.flags"], (), "no such channel"),
        ([], (), "none given"),
        (NAMES, (5.0, 1.0), "no stretch"),
        (NAMES, (float("nan"), 1.0), "no stretch"),
        (NAMES, (0.0, 1e300), "no stretch"),
        (NAMES, (0.0, 1.0, 0), "points"),
        (NAMES, (0.0, 1.0, 10**9), "points"),
    ],
)
def test_what_is_not_there_is_refused(folder: Path, names: list[str], given: tuple[float, ...], said: str) -> None:
    with pytest.raises(InputError, match=said):
        window(folder, names, *given)  # type: ignore[arg-type]
