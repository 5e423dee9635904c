"""Record files: the same bytes for the same rows, readable to the last whole block wherever they are cut."""

import io
import itertools
import json
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hil.errors import InputError
from hil.records.blocks import read_blocks
from hil.records.layout import Column, Layout, block_rows_for
from hil.records.stream import BlockWriter

BLOCK = 8
LAYOUT = Layout("sample", (Column("tick", "i8"), Column("code", "i4", "V", 0.5), Column("flag", "u1")), BLOCK)


def rows(count, first=0):
    made = np.zeros(count, LAYOUT.dtype)
    made["tick"] = np.arange(first, first + count)
    made["code"] = -3 * made["tick"]
    made["flag"] = made["tick"] % 7
    return made


def written(path, count, close=True):
    writer = BlockWriter(path, LAYOUT)
    writer.push(rows(count))
    if close:
        writer.close()
    return path.read_bytes()


def block_ends(data):
    """Offsets at which the header, each block, the end marker and the stream end."""
    source = pa.BufferReader(data)
    reader = pa.ipc.open_stream(source)
    ends = [source.tell()]
    while True:
        try:
            reader.read_next_batch()
        except StopIteration:
            return ends
        ends.append(source.tell())


@pytest.fixture
def file(tmp_path):
    return tmp_path / "sample.arrow"


def test_what_was_written_is_read(file):
    written(file, 3 * BLOCK + 5)
    blocks = read_blocks(file, "sample")
    assert blocks.complete
    assert blocks.rows == 3 * BLOCK + 5
    for name in LAYOUT.dtype.names:
        np.testing.assert_array_equal(blocks.columns[name], rows(3 * BLOCK + 5)[name])
    assert blocks.header["columns"]["code"] == {"unit": "V", "scale": 0.5}


@pytest.mark.moderate
@settings(deadline=None, max_examples=30)
@given(cuts=st.lists(st.integers(0, 40), max_size=6), single=st.booleans())
def test_bytes_do_not_depend_on_how_rows_were_handed_over(tmp_path_factory, cuts, single):
    folder = tmp_path_factory.mktemp("grouping")
    expected = written(folder / "whole.arrow", 40)
    edges = sorted({0, *cuts, 40})
    with BlockWriter(folder / "parts.arrow", LAYOUT) as writer:
        for start, stop in itertools.pairwise(edges):
            part = rows(stop - start, start)
            if single:
                for row in part:
                    assert writer.put(*row.tolist())
            else:
                assert writer.push(part) == part.size
    assert (folder / "parts.arrow").read_bytes() == expected


def test_a_block_is_on_its_way_as_soon_as_it_is_full(file):
    writer = BlockWriter(file, LAYOUT)
    for count in range(1, 3 * BLOCK + 1):
        writer.push(rows(1, count - 1))
        blocks = read_blocks(file, "sample")
        assert (blocks.rows, blocks.complete) == (count // BLOCK * BLOCK, False)
    writer.close()


@pytest.mark.slow
def test_a_file_cut_at_any_byte_gives_its_whole_blocks(tmp_path):
    data = written(tmp_path / "whole.arrow", 2 * BLOCK + 5)
    _header, opened, *ends = block_ends(data)
    file = tmp_path / "cut.arrow"
    for size in range(opened, len(data) + 1):
        file.write_bytes(data[:size])
        blocks = read_blocks(file, "sample")
        whole = sum(end <= size for end in ends)
        assert blocks.complete == (whole == len(ends)), size
        assert blocks.rows == min(whole * BLOCK, 2 * BLOCK + 5), size
        np.testing.assert_array_equal(blocks.columns["tick"], np.arange(blocks.rows))


@pytest.mark.moderate
def test_a_file_cut_inside_its_header_is_refused(tmp_path):
    data = written(tmp_path / "whole.arrow", BLOCK)
    file = tmp_path / "cut.arrow"
    for size in range(block_ends(data)[1]):  # the empty first block is written together with it
        file.write_bytes(data[:size])
        with pytest.raises(InputError, match="cut inside its header"):
            read_blocks(file, "sample")


def test_a_missing_block_is_told(tmp_path):
    data = written(tmp_path / "whole.arrow", 4 * BLOCK)
    _header, _opening, first, second, *_ = block_ends(data)
    file = tmp_path / "spliced.arrow"
    file.write_bytes(data[:first] + data[second:])
    with pytest.raises(InputError, match=r"spliced\.arrow: block 2, from row 8 on, is damaged: .* keeps the 8 rows"):
        read_blocks(file, "sample")


def test_a_block_of_another_record_is_told(tmp_path):
    other = Layout(LAYOUT.kind, LAYOUT.columns, BLOCK)
    with BlockWriter(tmp_path / "other.arrow", other) as writer:
        changed = rows(4 * BLOCK)
        changed["code"][0] += 1
        writer.push(changed)
    ours, theirs = written(tmp_path / "ours.arrow", 4 * BLOCK), (tmp_path / "other.arrow").read_bytes()
    start, stop = block_ends(ours)[2:4]
    file = tmp_path / "mixed.arrow"
    file.write_bytes(ours[:start] + theirs[start:stop] + ours[stop:])
    with pytest.raises(InputError, match="block 2, from row 8 on, is damaged"):
        read_blocks(file, "sample")


@pytest.mark.long
def test_every_bit_counts(tmp_path):
    data = written(tmp_path / "whole.arrow", 2 * BLOCK + 5)
    file = tmp_path / "flipped.arrow"
    for place, bit in itertools.chain.from_iterable(((n, 5), (n, n % 8)) for n in range(len(data))):
        # Bit 5 makes a capital of a letter: of a hexadecimal digit, the same number.
        flipped = bytearray(data)
        flipped[place] ^= 1 << bit
        file.write_bytes(flipped)
        with pytest.raises(InputError, match=r"flipped\.arrow: .*(is damaged|cut inside its header)"):
            read_blocks(file, "sample")


def test_a_record_without_checksums_is_refused_in_one_line(file):
    """As they were written before there were any; none of the version before is so."""
    header = {"kind": "sample", "version": 1, "columns": {"tick": {"unit": "", "scale": 1.0}}}
    table = pa.table({"tick": np.arange(9)}).replace_schema_metadata({b"gyrohil": json.dumps(header)})
    with pa.ipc.new_stream(str(file), table.schema) as stream:
        stream.write_table(table)
    with pytest.raises(InputError, match="a record without checksums, which this program does not read; use the hil"):
        read_blocks(file, "sample")


def test_a_part_is_what_the_whole_has_there(file):
    written(file, 5 * BLOCK + 3)
    columns = read_blocks(file, "sample").columns
    for start, stop in itertools.combinations(
        [0, 1, BLOCK - 1, BLOCK, 2 * BLOCK + 4, 5 * BLOCK, 5 * BLOCK + 3, 999], 2
    ):
        for name in columns:
            np.testing.assert_array_equal(columns.part(start, stop)[name], columns[name][start:stop])
            again = columns.part(1, 40).part(start, stop)[name]
            np.testing.assert_array_equal(again, columns[name][1:40][start:stop])


def test_any_reader_of_arrow_opens_it(file):
    written(file, 2 * BLOCK + 1)
    with pa.ipc.open_stream(str(file)) as stream:
        assert stream.read_all()["tick"].to_pylist() == list(range(2 * BLOCK + 1))


@pytest.mark.moderate
@settings(deadline=None, max_examples=150)
@given(where=st.floats(0, 1, exclude_max=True), bits=st.integers(1, 255))
def test_a_damaged_file_is_read_or_refused_but_never_more(tmp_path_factory, where, bits):
    folder = tmp_path_factory.mktemp("damaged")
    data = bytearray(written(folder / "whole.arrow", 3 * BLOCK))
    data[int(where * len(data))] ^= bits
    file = folder / "damaged.arrow"
    file.write_bytes(data)
    try:
        rows_read = read_blocks(file, "sample").rows
    except InputError:
        return
    assert rows_read in (0, BLOCK, 2 * BLOCK, 3 * BLOCK)


@pytest.mark.parametrize("content", [b"", b"t_s,vx_V\n0,1\n", bytes(range(256)) * 16, b"\x00" * 300, b"ARROW1\x00\x00"])
def test_what_is_no_record_is_refused(file, content):
    file.write_bytes(content)
    with pytest.raises(InputError, match=r"sample\.arrow: no capture record"):
        read_blocks(file, "capture")


def test_an_arrow_stream_from_elsewhere_is_refused(file):
    table = pa.table({"tick": [1, 2]})
    buffer = io.BytesIO()
    with pa.ipc.new_stream(buffer, table.schema) as stream:
        stream.write_table(table)
    file.write_bytes(buffer.getvalue())
    with pytest.raises(InputError, match="without this bench's header"):
        read_blocks(file, "sample")


def test_another_kind_and_a_newer_version_are_refused(file, monkeypatch):
    written(file, 1)
    with pytest.raises(InputError, match="holds 'sample', not 'capture'"):
        read_blocks(file, "capture")
    monkeypatch.setattr("hil.records.blocks.VERSION", 0)
    with pytest.raises(InputError, match="version 1, this program reads 0"):
        read_blocks(file, "sample")


def test_a_file_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"gone\.arrow: cannot be read \(no such file or directory\)"):
        read_blocks(tmp_path / "gone.arrow", "capture")
    with pytest.raises(InputError, match="cannot be read"):
        read_blocks(tmp_path, "capture")


def test_a_writer_whose_body_raised_leaves_no_end_marker(file):
    def interrupted():
        with BlockWriter(file, LAYOUT) as writer:
            writer.push(rows(BLOCK + 3))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    blocks = read_blocks(file, "sample")
    assert (blocks.rows, blocks.complete) == (BLOCK + 3, False)


def test_closing_twice_changes_nothing(file):
    writer = BlockWriter(file, LAYOUT)
    writer.push(rows(3))
    writer.close()
    once = file.read_bytes()
    writer.close()
    writer.abandon()
    assert file.read_bytes() == once


@pytest.mark.moderate
def test_kill_9_leaves_every_whole_block(file):
    program = (
        "import itertools, sys\n"
        "from pathlib import Path\n"
        "from hil.records.stream import BlockWriter\n"
        "from tests.records.test_stream import LAYOUT\n"
        "writer = BlockWriter(Path(sys.argv[1]), LAYOUT)\n"
        "for tick in itertools.count():\n"
        "    writer.put(tick, -3 * tick, tick % 7)\n"
        "    if tick == 1003:\n"
        "        print('going', flush=True)\n"
    )
    root = Path(__file__).parents[2]
    child = subprocess.Popen([sys.executable, "-c", program, file], stdout=subprocess.PIPE, cwd=root)
    with child:
        assert child.stdout.readline() == b"going\n"
        child.send_signal(signal.SIGKILL)
    blocks = read_blocks(file, "sample")
    assert not blocks.complete
    assert blocks.rows >= 1003 // BLOCK * BLOCK
    assert blocks.rows % BLOCK == 0
    np.testing.assert_array_equal(blocks.columns["code"], rows(blocks.rows)["code"])


@pytest.mark.parametrize(
    ("rate_Hz", "expected"), [(1.0, 64), (610.35, 128), (4000.0, 1024), (200e3, 65_536), (1e9, 65_536)]
)
def test_a_block_is_about_a_quarter_of_a_second(rate_Hz, expected):
    assert block_rows_for(rate_Hz) == expected


def test_a_layout_survives_the_way_to_another_process():
    again = Layout.from_json(LAYOUT.to_json())
    assert again == LAYOUT
    assert again.header_json([1, 2]) == LAYOUT.header_json([1, 2])


def test_a_record_is_written_without_pandas(tmp_path):
    """Which Arrow loads, where it is installed, as soon as it is given numbers: half a second before a run arms."""
    writes = f"""
import sys
from pathlib import Path
import numpy as np
from hil.records.layout import Column, Layout
from hil.records.stream import BlockWriter
layout = Layout("sample", (Column("tick", "i8"), Column("code", "i4", "V", 0.5), Column("flag", "u1")), {BLOCK})
writer = BlockWriter(Path(sys.argv[1]), layout)
writer.push(np.ones({BLOCK + 1}, layout.dtype))
writer.close()
assert "pandas" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", writes, tmp_path / "r.arrow"], check=True, cwd=Path(__file__).parents[2])
