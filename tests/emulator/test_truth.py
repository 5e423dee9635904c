"""The truth file: what it holds, and what a kill leaves of it."""

import json
import resource
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from device_emulator.device import CODE_COLUMNS, TRUTH_COLUMNS, Device
from device_emulator.scenario import Scenario
from device_emulator.section import ScenarioError
from device_emulator.truth_file import BLOCK_ROWS, TruthFile, truth_metadata
from hil.errors import InputError
from hil.records.blocks import read_blocks
from tests.emulator.gyro import record, scenario, undriven


def write(path: Path, what: Scenario, rows: int, every: int = 1, *, close: bool = True) -> TruthFile:
    truth = TruthFile(path, truth_metadata(what, None, every))
    device = Device(what, sink=truth.add)
    device.rows(undriven(rows))
    if close:
        device.close()
        truth.close()
    return truth


def read(path: Path) -> tuple[pa.Table, dict[str, Any]]:
    with pa.OSFile(str(path)) as file:
        table = pa.ipc.open_stream(file).read_all()
    return table, json.loads(table.schema.metadata[b"gyrohil"])


def test_every_row_of_the_device(tmp_path: Path) -> None:
    what = scenario({"truth": {"temperature_K": 300.0}, "drive": {"noise_mps2_per_rtHz": 1e-3}})
    n = BLOCK_ROWS + 100
    write(tmp_path / "truth.arrow", what, n)
    table, _ = read(tmp_path / "truth.arrow")
    assert table.column_names == ["tick", *TRUTH_COLUMNS, *CODE_COLUMNS]
    np.testing.assert_array_equal(table["tick"], np.arange(n))
    truth = record(what, undriven(n)).truth
    for name in TRUTH_COLUMNS:
        np.testing.assert_array_equal(table[name], truth[name])


@pytest.mark.parametrize("every", [7, 64, 100])
def test_decimated(tmp_path: Path, every: int) -> None:
    write(tmp_path / "truth.arrow", scenario(), 1000, every)
    table, metadata = read(tmp_path / "truth.arrow")
    assert metadata["every"] == every
    np.testing.assert_array_equal(table["tick"], np.arange(0, 1000, every))
    np.testing.assert_array_equal(table["x_m"], record(scenario(), undriven(1000)).truth["x_m"][::every])


def test_metadata_tells_the_truth_per_unit_mass(tmp_path: Path) -> None:
    what = scenario(
        {
            "seed": 5,
            "truth": {"mass_kg": 2e-3, "stiffness_N_per_m": [2000.0, 1000.0, 10.0]},
            "sense": {"noise_V": 1e-5},
            "effect": [{"name": "sense_gain", "gy": 0.01}],
        }
    )
    write(tmp_path / "truth.arrow", what, 1)
    _, metadata = read(tmp_path / "truth.arrow")
    assert metadata.pop("checksum")["method"] == "CRC-32C"
    assert metadata == {
        "kind": "truth",
        "version": 1,
        "every": 1,
        "sample_rate_Hz": 4000.0,
        "mass_kg": 2e-3,
        "stiffness_per_s2": [1e6, 5e5, 5e3],
        "damping_per_s": pytest.approx([1.38230e-3 / 2e-3, 1.13097e-3 / 2e-3, 6.2832e-5 / 2e-3]),
        "sense_gain_V_per_m": pytest.approx([-885.41878128] * 2),
        "noise_V": 1e-5,
        "seed": 5,
        "effects": [{"name": "sense_gain", "coefficients": {"gx": 0.0, "gy": 0.01}}],
    }


def test_a_kill_leaves_whole_blocks(tmp_path: Path) -> None:
    """Nobody closes the file; what a reader finds is every whole block."""
    path = tmp_path / "truth.arrow"
    truth = write(path, scenario(), 2 * BLOCK_ROWS + 300, close=False)
    with pa.OSFile(str(path)) as file:
        rows = [len(batch) for batch in pa.ipc.open_stream(file)]
    assert rows == [0, BLOCK_ROWS, BLOCK_ROWS]
    truth.close()


def test_closing_twice_does_nothing(tmp_path: Path) -> None:
    truth = write(tmp_path / "truth.arrow", scenario(), 10)
    size = (tmp_path / "truth.arrow").stat().st_size
    truth.close()
    assert (tmp_path / "truth.arrow").stat().st_size == size


def test_a_file_that_cannot_be_made(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="cannot write the truth file") as caught:
        TruthFile(tmp_path / "none" / "truth.arrow", truth_metadata(scenario(), None))
    assert "\n" not in str(caught.value)


def test_what_is_there_is_not_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "truth.arrow"
    path.write_text("the record of a long night")
    with pytest.raises(ScenarioError, match=r"truth\.arrow: exists already; give another truth file"):
        TruthFile(path, truth_metadata(scenario(), None))
    assert path.read_text() == "the record of a long night"


@pytest.mark.moderate
def test_the_bench_finds_every_block_whole_and_the_codes_in_it(tmp_path: Path) -> None:
    """The emulator's checksums and the bench's reader come from the same page, not from the same code."""
    what, n = scenario(), 2 * BLOCK_ROWS + 300
    write(tmp_path / "truth.arrow", what, n)
    blocks = read_blocks(tmp_path / "truth.arrow", "truth")
    assert (blocks.rows, blocks.complete) == (n, True)
    sent = Device(what).rows(undriven(n))
    np.testing.assert_array_equal(np.column_stack([blocks.columns["vx_code"], blocks.columns["vy_code"]]), sent)
    data = bytearray((tmp_path / "truth.arrow").read_bytes())
    data[len(data) // 2] ^= 1
    (tmp_path / "truth.arrow").write_bytes(data)
    with pytest.raises(InputError, match=r"truth\.arrow: block 2, .* is damaged"):
        read_blocks(tmp_path / "truth.arrow", "truth")


@pytest.mark.moderate
def test_a_full_disk_is_one_line_and_leaves_whole_blocks(tmp_path: Path) -> None:
    whole = tmp_path / "whole.arrow"
    write(whole, scenario(), 3 * BLOCK_ROWS)
    small = tmp_path / "small"
    small.mkdir()
    with (
        limited_to(whole.stat().st_size // 2),
        pytest.raises(ScenarioError, match="cannot write the truth file") as told,
    ):
        write(small / "truth.arrow", scenario(), 3 * BLOCK_ROWS)
    assert "\n" not in str(told.value)
    assert read_blocks(small / "truth.arrow", "truth").rows == BLOCK_ROWS


@contextmanager
def limited_to(size: int) -> Iterator[None]:
    """No file may grow beyond `size` bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, ignored)
