"""One more reader of a ring, of whom neither side knows: rows whole and in order, or counted as passed over."""

import os
import subprocess
import sys
import time

import numpy as np
import pytest

from hil.running.recording.ring import Onlooker, Ring

ROW = np.dtype([("tick", "<i8"), ("a", "<f8"), ("b", "<f8")])

PRODUCER = """
import sys, time
import numpy as np
from hil.running.recording.ring import Ring
from tests.running.test_onlooker import ROW, rows
ring = Ring.attach(sys.argv[1])
ring.while_full = lambda: True
tick, end = 0, time.monotonic() + float(sys.argv[2])
while time.monotonic() < end:
    ring.push(rows(tick, 500))
    tick += 500
ring.finish()
print(tick)
"""


def rows(first: int, count: int) -> np.ndarray:
    made = np.empty(count, ROW)
    made["tick"] = np.arange(first, first + count)
    made["a"] = made["tick"] * 0.5
    made["b"] = -made["a"]
    return made


@pytest.fixture
def ring():
    made = Ring.create(f"{os.getpid()}-{time.monotonic_ns()}-onlooker", ROW, 1 << 12)
    yield made
    made.unlink()
    made.detach()


def onlooker_of(ring: Ring) -> Onlooker:
    descriptor = os.open(ring.path, os.O_RDONLY)
    try:
        return Onlooker(descriptor)
    finally:
        os.close(descriptor)


def test_it_sees_what_the_reader_sees_and_takes_nothing_from_it(ring: Ring) -> None:
    ring.push(rows(0, 100))
    look = onlooker_of(ring)
    assert len(look.look(1000)) == 0  # what was there before is not news
    ring.push(rows(100, 300))
    np.testing.assert_array_equal(look.look(1000), rows(100, 300))
    assert len(look.look(1000)) == 0
    np.testing.assert_array_equal(ring.pop(), rows(0, 400))
    assert ring.dropped == 0
    look.detach()


def test_what_is_too_old_is_counted(ring: Ring) -> None:
    look = onlooker_of(ring)
    ring.push(rows(0, 900))
    np.testing.assert_array_equal(look.look(200), rows(700, 200))
    assert look.lost == 700
    for first in range(900, 9900, 900):
        ring.pop()
        ring.push(rows(first, 900))
    seen = look.look(1 << 20)
    assert seen["tick"][-1] == 9899
    np.testing.assert_array_equal(seen, rows(int(seen["tick"][0]), len(seen)))
    assert look.lost == 700 + int(seen["tick"][0]) - 900
    assert len(seen) <= ring.capacity - 1000  # of which a producer may be writing the rest over


def test_it_can_only_look(ring: Ring) -> None:
    look = onlooker_of(ring)
    with pytest.raises((TypeError, ValueError)):
        look._memory[0:1] = b"x"
    look.detach()


@pytest.mark.long
def test_rows_are_whole_beside_a_producer_that_never_stops(ring: Ring) -> None:
    look = onlooker_of(ring)
    name = ring.path.name.removeprefix("gyrohil-")
    with subprocess.Popen([sys.executable, "-c", PRODUCER, name, "1.5"], stdout=subprocess.PIPE) as producer:
        seen = next_tick = 0
        while producer.poll() is None or look._words[16]:
            ring.pop()
            found = look.look(1 << 20)
            if len(found):
                first = int(found["tick"][0])
                assert first >= next_tick
                np.testing.assert_array_equal(found, rows(first, len(found)))
                next_tick = int(found["tick"][-1]) + 1
                seen += len(found)
            if producer.poll() is not None and not len(found):
                break
        assert producer.stdout is not None
        written = int(producer.stdout.read())
    assert look.closed
    assert seen + look.lost == written
    assert seen > 0
    look.detach()
