"""SENSE: blocks and single rows, in both widths, mean the same bytes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from hil.wire.errors import ProtocolError
from hil.wire.sense import MAX_ROWS, Sense, decode_sense, encode_sense

untimed = settings(deadline=None)
widths = st.sampled_from([2, 3])


def codes(width: int, rows: st.SearchStrategy[int]) -> st.SearchStrategy[np.ndarray]:
    limit = 1 << 8 * width - 1
    shapes = rows.map(lambda n: (n, 4))
    return hnp.arrays(np.int32, shapes, elements=st.integers(-limit, limit - 1))


@pytest.mark.moderate
@untimed
@given(st.data(), widths, st.integers(0, 255), st.integers(0, 255))
def test_blocks_come_back(data, width, flags, matrix_id):
    block = data.draw(codes(width, st.integers(1, 40)))
    payload = encode_sense(Sense(block, width, flags, matrix_id))
    assert len(payload) == 5 + block.size * width
    back = decode_sense(payload)
    assert back.codes.dtype == np.int32
    assert np.array_equal(back.codes, block)
    assert back[1:] == (width, flags, matrix_id)


@pytest.mark.parametrize("width", [2, 3])
def test_codes_are_little_endian_twos_complement(width):
    row = (1, -1, 256, -(1 << 8 * width - 1))
    payload = encode_sense(Sense(np.array([row], np.int32), width, 0, 9))
    assert payload == bytes([1, 0, width, 0, 9]) + b"".join(code.to_bytes(width, "little", signed=True) for code in row)


@pytest.mark.parametrize("width", [2, 3])
def test_the_longest_block_fits_and_one_row_more_does_not(width):
    block = np.zeros((MAX_ROWS[width] + 1, 4), np.int32)
    assert np.array_equal(decode_sense(encode_sense(Sense(block[1:], width, 0))).codes, block[1:])
    with pytest.raises(ProtocolError, match=rf"expected \(n, 4\), 1 ≤ n ≤ {MAX_ROWS[width]}"):
        encode_sense(Sense(block, width, 0))


@pytest.mark.parametrize("shape", [(0, 4), (3, 3), (4,)])
def test_other_shapes_are_refused(shape):
    with pytest.raises(ProtocolError, match="SENSE: codes of shape"):
        encode_sense(Sense(np.zeros(shape, np.int32), 2, 0))


@pytest.mark.parametrize(("width", "code"), [(2, 32768), (2, -32769), (3, 1 << 23), (3, -(1 << 23) - 1)])
def test_codes_that_do_not_fit_are_refused(width, code):
    with pytest.raises(ProtocolError, match=f"does not fit into {width} bytes"):
        encode_sense(Sense(np.array([[0, 0, 0, code]], np.int32), width, 0))


@pytest.mark.parametrize("width", [0, 1, 4])
def test_other_widths_are_refused(width):
    with pytest.raises(ProtocolError, match=f"SENSE.width: {width} bytes per code; expected 2 or 3"):
        encode_sense(Sense(np.zeros((1, 4), np.int32), width, 0))


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"\1\0\2\0",
        b"\1\0\2\0\0" + bytes(7),
        b"\1\0\2\0\0" + bytes(9),
        b"\0\0\2\0\0",
        b"\2\0\1\0\0" + bytes(8),
    ],
)
def test_payloads_that_contradict_themselves_are_refused(payload):
    with pytest.raises(ProtocolError, match="SENSE"):
        decode_sense(payload)
