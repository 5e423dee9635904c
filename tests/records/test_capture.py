"""Captures: codes become SI, gaps are flagged, nothing of the machine is in the file."""

import numpy as np
import pytest

from hil.errors import InputError
from hil.records.capture import RowFlag, board_layout, import_layout, read_capture
from hil.records.stream import BlockWriter
from hil.records.timing import timing_layout


def board(path, axes=2, ticks=range(6), **fields):
    layout = board_layout(
        tick_rate_Hz=2000.0,
        axes=axes,
        latency_ticks=3,
        sense_scale_V=2e-5,
        drive_scale=5e-3,
        identity={"unique_id": "0a", "firmware": 7},
    )
    rows = np.zeros(len(ticks), layout.dtype)
    rows["tick"] = ticks
    for name, values in fields.items():
        rows[name] = values
    with BlockWriter(path, layout) as writer:
        writer.push(rows)
    return read_capture(path)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "capture.arrow"


def test_codes_become_volts_and_drive_units(path):
    capture = board(path, vx_code=100, vy_code=-200, ux_code=[0, 1, 2, 3, 4, 5], uy_code=-1)
    np.testing.assert_allclose(capture.sense_V, np.tile([2e-3, -4e-3], (6, 1)))
    np.testing.assert_allclose(capture.drive[:, 0], 5e-3 * np.arange(6))
    np.testing.assert_allclose(capture.drive[:, 1], -5e-3)
    assert (capture.drive_unit, capture.hold, capture.latency_ticks) == ("mps2", "zoh", 3)
    np.testing.assert_allclose(capture.t_s, np.arange(6) / 2000.0)
    assert capture.header["identity"]["firmware"] == 7
    assert capture.complete


def test_one_axis_has_one_column_each(path):
    capture = board(path, axes=1, vx_code=5)
    assert capture.sense_V.shape == capture.drive.shape == (6, 1)
    assert capture.rate_rad_s is None
    assert capture.temp_C is None


def test_a_jump_in_the_ticks_is_a_gap_whoever_made_it(path):
    flags = [RowFlag.ADC_CLIPPED, 0, 0, 0, RowFlag.LATE_ANSWER_HELD, 0]
    capture = board(path, ticks=[2, 3, 7, 8, 9, 2**40], flags=flags)
    gap = RowFlag.GAP_BEFORE
    assert capture.flags.tolist() == [RowFlag.ADC_CLIPPED, 0, gap, 0, RowFlag.LATE_ANSWER_HELD, gap]


def test_a_capture_says_nothing_of_where_and_when(path):
    board(path)
    content = path.read_bytes()
    assert str(path.parent).encode() not in content
    other = path.parent / "elsewhere.arrow"
    board(other)
    assert other.read_bytes() == content


def imported(path, names=("t_s", "vx_V", "ux_N"), segments=None):
    layout = import_layout(
        names,
        tick_rate_Hz=10.0,
        uniform=False,
        hold="foh",
        segments=segments or {"train": (1, 3), "test": (3, 5)},
    )
    rows = np.zeros(5, layout.dtype)
    rows["tick"] = np.arange(5)
    for column, name in enumerate(names):
        rows[name] = np.arange(5) ** 2 * (column + 1)
    with BlockWriter(path, layout) as writer:
        writer.push(rows)
    return read_capture(path)


def test_imported_columns_are_as_they_were(path):
    capture = imported(path, ("t_s", "vx_V", "ux_N", "rate_rad_s", "temp_C"))
    np.testing.assert_array_equal(capture.t_s, np.arange(5) ** 2)
    np.testing.assert_array_equal(capture.sense_V[:, 0], 2 * np.arange(5) ** 2)
    np.testing.assert_array_equal(capture.drive[:, 0], 3 * np.arange(5) ** 2)
    np.testing.assert_array_equal(capture.rate_rad_s, 4 * np.arange(5) ** 2)
    np.testing.assert_array_equal(capture.temp_C, 5 * np.arange(5) ** 2)
    assert (capture.drive_unit, capture.hold, capture.uniform) == ("N", "foh", False)
    assert not capture.flags.any()


def test_a_free_response_has_no_drive(path):
    capture = imported(path, ("t_s", "vx_V", "vy_V"))
    assert not capture.has_drive
    assert capture.drive.shape == (5, 2)
    assert not capture.drive.any()


def test_segments_are_parts_of_the_record(path):
    capture = imported(path)
    assert capture.segments == {"train": (1, 3), "test": (3, 5)}
    train = capture.segment("train")
    np.testing.assert_array_equal(train.tick, [1, 2])
    np.testing.assert_array_equal(train.t_s, [1, 4])
    assert train.segments == {}
    with pytest.raises(InputError, match="'arrow': not in this capture; it has: train, test"):
        capture.segment("arrow")


def test_another_record_is_no_capture(path):
    with BlockWriter(path, timing_layout(tick_rate_Hz=1.0)):
        pass
    with pytest.raises(InputError, match="holds 'timing', not 'capture'"):
        read_capture(path)
