"""The shared-memory ring between two real processes: in order, whole, counted."""

import os
import signal
import subprocess
import sys
import uuid
from pathlib import Path

import numpy as np
import pytest

from hil.running.recording.ring import Ring

ROOT = Path(__file__).parents[2]
DTYPE = np.dtype([("tick", "<i8"), ("a", "<i4"), ("b", "<f8"), ("flag", "u1")])


@pytest.fixture
def name():
    return f"test-{uuid.uuid4().hex}"


@pytest.fixture
def ring(name):
    with Ring.create(name, DTYPE, 10) as made:
        yield made
        made.unlink()


def rows(first, count):
    """Rows whose every field follows from the tick, so that a torn one shows."""
    made = np.zeros(count, DTYPE)
    tick = np.arange(first, first + count)
    made["tick"], made["a"], made["b"], made["flag"] = tick, tick * 7 % 100_003, tick * 0.5, tick % 251
    return made


def test_rows_come_out_as_they_went_in(ring):
    assert ring.push(rows(0, 4)) == 4
    assert ring.put(*rows(4, 1)[0].tolist())
    np.testing.assert_array_equal(ring.pop(), rows(0, 5))
    assert ring.pop().size == 0


def test_it_wraps_around(ring):
    first = 0
    for count in (7, 7, 10, 1, 9, 3, 10):
        assert ring.push(rows(first, count)) == count
        np.testing.assert_array_equal(ring.pop(), rows(first, count))
        first += count


def test_what_finds_no_room_is_dropped_and_counted(ring):
    assert ring.push(rows(0, 14)) == 10
    assert not ring.put(*rows(14, 1)[0].tolist())
    assert ring.push(rows(15, 2)) == 0
    assert ring.dropped == 7
    np.testing.assert_array_equal(ring.pop(), rows(0, 10))
    assert ring.push(rows(17, 2)) == 2
    np.testing.assert_array_equal(ring.pop(), rows(17, 2))
    assert ring.dropped == 7


def test_a_producer_that_may_wait_waits_for_room(ring):
    seen = []

    def drain():
        seen.append(ring.pop())
        return True

    ring.while_full = drain
    assert ring.push(rows(0, 35)) == 35
    assert ring.put(*rows(35, 1)[0].tolist())
    seen.append(ring.pop())
    np.testing.assert_array_equal(np.concatenate(seen), rows(0, 36))
    assert ring.dropped == 0


def test_a_producer_stops_waiting_when_told(ring):
    ring.while_full = lambda: False
    assert ring.push(rows(0, 12)) == 10
    assert ring.dropped == 2


def test_the_consumer_learns_that_the_producer_is_done(ring, name):
    with Ring.attach(name) as consumer:
        assert not consumer.closed
        ring.finish()
        assert consumer.closed


def test_names_are_taken_once_and_go_with_unlink(ring, name):
    with pytest.raises(FileExistsError):
        Ring.create(name, DTYPE, 10)
    ring.unlink()
    with pytest.raises(FileNotFoundError):
        Ring.attach(name)
    assert ring.push(rows(0, 3)) == 3  # who has it open keeps it


def test_a_file_that_is_no_ring_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("hil.running.recording.ring._directory", lambda: tmp_path)
    (tmp_path / "gyrohil-other").write_bytes(b"x" * 8192)
    with pytest.raises(ValueError, match="not a ring"):
        Ring.attach("other")


PRODUCER = """
import sys
from hil.running.recording.ring import Ring
from tests.running.test_ring import rows
name, total, mode = sys.argv[1], int(sys.argv[2]), sys.argv[3]
with Ring.attach(name) as ring:
    ring.while_full = (lambda: True) if mode == "wait" else None
    first = 0
    while first < total:
        count = min(1 + first % 97, total - first)
        ring.push(rows(first, count))
        first += count
    ring.finish()
"""


def produce(name, total, mode):
    return subprocess.Popen([sys.executable, "-c", PRODUCER, name, str(total), mode], cwd=ROOT)


def drain(ring, child):
    parts = []
    while not ring.closed and child.poll() is None:
        parts.append(ring.pop())
    child.wait()
    parts.append(ring.pop())
    return np.concatenate(parts)


@pytest.mark.slow
def test_two_processes_lose_nothing_when_the_producer_waits(name):
    with Ring.create(name, DTYPE, 256) as ring, produce(name, 200_000, "wait") as child:
        received = drain(ring, child)
        ring.unlink()
    assert child.returncode == 0
    np.testing.assert_array_equal(received, rows(0, 200_000))
    assert ring.path.exists() is False


@pytest.mark.slow
def test_two_processes_see_whole_rows_and_count_what_is_missing(name):
    with Ring.create(name, DTYPE, 256) as ring, produce(name, 200_000, "drop") as child:
        received = drain(ring, child)
        dropped = ring.dropped
        ring.unlink()
    assert child.returncode == 0
    assert received.size + dropped == 200_000
    assert np.all(np.diff(received["tick"]) > 0)
    for field in DTYPE.names:
        np.testing.assert_array_equal(received[field], rows(0, 200_000)[field][received["tick"]])


@pytest.mark.slow
def test_a_killed_producer_leaves_whole_rows(name):
    with Ring.create(name, DTYPE, 4096) as ring, produce(name, 10**9, "wait") as child:
        received = [ring.pop()]
        while sum(part.size for part in received) < 20_000:
            received.append(ring.pop())
        os.kill(child.pid, signal.SIGKILL)
        child.wait()
        received.append(ring.pop())
        assert not ring.closed
        ring.unlink()
    together = np.concatenate(received)
    np.testing.assert_array_equal(together, rows(0, together.size))
