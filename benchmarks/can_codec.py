"""CAN FD: encoding and decoding of blocks of four 16-bit channels, on one core, without a bus.

From a block of codes to the records a socket would take, and from those records to codes again, through the product's
own sender and receiver: sequence numbers, ticks, blocks of 7 rows a frame, one NumPy array a frame at the end.
"""

import time

import numpy as np

from benchmarks.row import Row, Say
from hil.wire.can_format import RECORD_SIZE, CanFormat
from hil.wire.frame_format import BOARD, HOST
from hil.wire.messages import DriveForce
from hil.wire.sense import Sense
from hil.wire.stream import Receiver, Transmitter

SECONDS = 5.0
BLOCK = 252  # rows; 36 full frames
READ = 16  # records that one read of the socket brings
TARGET = 50e3  # samples a second


def rows(say: Say) -> list[Row]:
    """Samples a second: blocks, and one row a frame as in force mode."""
    return [_blocks(say), _single_rows(say)]


def _blocks(say: Say) -> Row:
    codes = np.random.default_rng(1).integers(-(2**15), 2**15, (BLOCK, 4)).astype(np.int32)
    block = Sense(codes, 2, 0)
    board, host = Transmitter(CanFormat(0, BOARD)), Receiver(CanFormat(0, HOST))
    done = 0
    begin = time.process_time()
    while (spent := time.process_time() - begin) < SECONDS:
        data = board.encode(block, done)
        got = 0
        for at in range(0, len(data), READ * RECORD_SIZE):
            for item in host.feed(data[at : at + READ * RECORD_SIZE]):
                assert isinstance(item.message, Sense)
                got += len(item.message.codes)
        done += got
    assert host.lost == host.bad == 0
    say(f"{done} samples in {spent:.2f} s of one core")
    return Row("CAN FD encode + decode, blocks", done / spent, "samples/s", "50 kS/s", done / spent / TARGET)


def _single_rows(say: Say) -> Row:
    board, host = Transmitter(CanFormat(0, BOARD)), Receiver(CanFormat(0, HOST))
    answer, heard = Transmitter(CanFormat(0, HOST)), Receiver(CanFormat(0, BOARD))
    host.feed(board.encode_row(0, 0, 0, 0, 0, 0, 2))
    heard.feed(answer.encode(DriveForce(0, 0, 0), 0))
    done = 1
    begin = time.process_time()
    while (spent := time.process_time() - begin) < SECONDS:
        for _ in range(1000):
            (row,) = host.feed(board.encode_row(done, 1, 2, 3, 4, 0, 2))
            drive = heard.take_drive(answer.encode(DriveForce(5, 6, row.tick + 1), row.tick))
            assert drive is not None
            done += 1
    say(f"{done} rows and their drives in {spent:.2f} s of one core")
    return Row(
        "CAN FD encode + decode, a row and its drive", done / spent, "samples/s", "50 kS/s", done / spent / TARGET
    )
