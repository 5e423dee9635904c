"""The recorder: the same files from the loop's process and from its own, whoever is killed."""

import os
import select
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from hil.records.atomic import make_run_folder, write_text
from hil.records.blocks import read_blocks
from hil.records.capture import board_layout, read_capture
from hil.records.timing import Timing, timing_layout
from hil.running.recording import recorder
from hil.running.recording.recorder import record_apart, record_here

ROOT = Path(__file__).parents[2]
LAYOUTS = {
    "capture": board_layout(tick_rate_Hz=1000.0, axes=2, latency_ticks=1, sense_scale_V=1e-5, drive_scale=1e-3),
    "timing": timing_layout(tick_rate_Hz=1000.0),
}


def fill(recording, count):
    for tick in range(count):
        recording["capture"].put(tick, tick % 100, -tick % 90, 5, -5, 0)
        if tick % 2:
            recording["timing"].put(tick, 10**6 * tick, 10**6 * tick + 4000, 0)


def children_of(process):
    return [int(child) for child in Path(f"/proc/{process}/task/{process}/children").read_text().split()]


def rings_left():
    return {path.name for path in Path("/dev/shm").glob(f"gyrohil-{os.getpid()}-*")}


@pytest.mark.slow
def test_a_process_of_its_own_writes_the_same_bytes(tmp_path):
    for folder, start in (("here", record_here), ("apart", record_apart)):
        (tmp_path / folder).mkdir()
        with start(tmp_path / folder, LAYOUTS) as recording:
            fill(recording, 3000)
        assert recording.dropped == {"capture": 0, "timing": 0}
    for name in ("capture.arrow", "timing.arrow"):
        assert (tmp_path / "here" / name).read_bytes() == (tmp_path / "apart" / name).read_bytes()
    assert read_capture(tmp_path / "apart" / "capture.arrow").complete
    assert not rings_left()


@pytest.mark.slow
def test_a_loop_that_may_wait_loses_nothing_in_a_small_ring(tmp_path):
    with record_apart(tmp_path, LAYOUTS, wait=True, ring_rows=dict.fromkeys(LAYOUTS, 128)) as recording:
        fill(recording, 2000)
    capture = read_capture(tmp_path / "capture.arrow")
    np.testing.assert_array_equal(capture.tick, np.arange(2000))


@pytest.mark.slow
def test_a_loop_that_may_not_wait_leaves_a_flagged_gap(tmp_path):
    with record_apart(tmp_path, {"capture": LAYOUTS["capture"]}, ring_rows={"capture": 16}) as recording:
        rows = np.zeros(50, LAYOUTS["capture"].dtype)
        rows["tick"] = np.arange(50)
        recording["capture"].push(rows)
        dropped = recording.dropped["capture"]
        recording["capture"].while_full = lambda: True
        rows["tick"] = np.arange(50, 100)
        recording["capture"].push(rows)
    capture = read_capture(tmp_path / "capture.arrow")
    assert dropped == 34
    np.testing.assert_array_equal(capture.tick, [*range(16), *range(50, 100)])
    np.testing.assert_array_equal(np.flatnonzero(capture.flags), [16])


@pytest.mark.slow
@pytest.mark.parametrize("start", [record_here, record_apart])
def test_a_body_that_raises_leaves_interrupted_files(tmp_path, start):
    def interrupted():
        with start(tmp_path, LAYOUTS) as recording:
            fill(recording, 700)
            raise RuntimeError("the plug was pulled")

    with pytest.raises(RuntimeError, match="pulled"):
        interrupted()
    capture = read_capture(tmp_path / "capture.arrow")
    assert (len(capture), capture.complete) == (700, False)


LOOP = """
import sys, time
from pathlib import Path
from hil.running.recording.recorder import record_apart
from tests.running.test_recorder import LAYOUTS, fill
with record_apart(Path(sys.argv[1]), LAYOUTS) as recording:
    fill(recording, 1500)
    print("filled", flush=True)
    time.sleep(60)
"""


@pytest.mark.slow
def test_a_killed_loop_keeps_everything_it_had_pushed(tmp_path):
    loop = subprocess.Popen([sys.executable, "-c", LOOP, tmp_path], stdout=subprocess.PIPE, cwd=ROOT)
    with loop:
        assert loop.stdout.readline() == b"filled\n"
        watched = [os.pidfd_open(child) for child in children_of(loop.pid)]
        loop.send_signal(signal.SIGKILL)
    for descriptor in watched:  # readable once the recorder has ended by itself
        with os.fdopen(descriptor) as ended:
            assert select.select([ended], [], [], 20)[0]
    capture, timing = read_capture(tmp_path / "capture.arrow"), Timing.read(tmp_path / "timing.arrow")
    assert (len(capture), capture.complete) == (1500, False)
    assert (timing.tick.size, timing.complete) == (750, False)


@pytest.mark.slow
def test_a_dead_recorder_is_told_of_and_holds_nobody_up(tmp_path):
    def abandoned():
        before = children_of(os.getpid())
        with record_apart(tmp_path, LAYOUTS, wait=True, ring_rows=dict.fromkeys(LAYOUTS, 64)) as recording:
            for child in set(children_of(os.getpid())) - set(before):
                os.kill(child, signal.SIGKILL)
            fill(recording, 5000)
            assert recording.dropped["capture"] > 0

    with pytest.raises(OSError, match="the recorder was killed by SIGKILL"):
        abandoned()
    assert not rings_left()


@pytest.mark.slow
def test_a_folder_that_is_not_there_is_told_at_the_start(tmp_path):
    with pytest.raises(OSError, match="the recorder did not start"):
        record_apart(tmp_path / "gone", LAYOUTS)
    assert not rings_left()


class _Waiting:
    """A ring from which nobody takes the rows that wait in it."""

    read, waiting = 7, True


@pytest.mark.parametrize(("queued", "told"), [(0.0, 2.0), (0.5, 4.0), (1.0, 10.0)])
def test_a_busy_machine_is_not_a_stuck_recorder(monkeypatch, queued, told):
    """docs/safety.md, host 9: time without a processor is not counted, up to ten seconds."""
    now = 100.0
    monkeypatch.setattr(recorder, "time", SimpleNamespace(monotonic=lambda: now))
    monkeypatch.setattr(recorder._Watch, "_queued", lambda _: queued * now)
    watch = recorder._Watch(SimpleNamespace(poll=lambda: None, pid=os.getpid()), {"capture": _Waiting()})
    assert watch.trouble() == ""  # notes how far it is
    now = 100.0 + told - 0.1
    assert watch.trouble() == ""
    now = 100.0 + told + 0.1
    assert watch.trouble() == f"the recorder is stuck: it has written nothing of capture for {told + 0.1:.1f} s"
    watch.close()


@pytest.mark.moderate
def test_time_without_a_processor_is_what_the_kernel_says():
    """Two that always want one processor have it for half of the time each."""
    place = min(os.sched_getaffinity(0))
    spin = [sys.executable, "-c", f"import os; os.sched_setaffinity(0, {{{place}}})\nwhile True: pass"]
    with subprocess.Popen(spin) as child, subprocess.Popen(spin) as other:
        try:
            watch = recorder._Watch(child, {})
            begun, before_s = time.monotonic(), watch._queued()
            while watch._queued() - before_s < 0.2:
                assert time.monotonic() - begun < 20.0
                time.sleep(0.05)
            assert watch._queued() - before_s <= time.monotonic() - begun
            watch.close()
        finally:
            child.kill()
            other.kill()


@pytest.mark.realtime(alone=True)  # it keeps a processor from all others
def test_a_recorder_that_was_killed_and_has_no_processor_to_die_on_is_told():
    """docs/safety.md, host 9: within a second. A real-time process holds the processor for half of one."""
    place = min(os.sched_getaffinity(0))
    here = f"import os, time; os.sched_setaffinity(0, {{{place}}})"
    hog = f"{here}\nos.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(9))\nprint('has it', flush=True)\n" + (
        "end = time.monotonic() + 0.5\nwhile time.monotonic() < end: pass"
    )
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    except PermissionError:
        pytest.skip("no process here may be of real time")
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    idle = f"{here}\nos.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))\nprint(1, flush=True)\ntime.sleep(60)"
    everywhere = os.sched_getaffinity(0)
    with subprocess.Popen([sys.executable, "-c", idle], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as child:
        assert child.stdout.readline()
        watch = recorder._Watch(child, {})
        assert watch.trouble() == ""
        try:
            if len(everywhere) > 1:
                os.sched_setaffinity(0, everywhere - {place})
            with subprocess.Popen([sys.executable, "-c", hog], stdout=subprocess.PIPE) as busy:
                assert busy.stdout.readline()
                child.kill()
                told, still_there = watch.trouble(), child.poll() is None
        finally:
            os.sched_setaffinity(0, everywhere)
        assert told == "the recorder was killed by SIGKILL"
        assert still_there or len(everywhere) == 1
        child.wait()
        watch.close()


def test_a_recorder_whose_end_has_begun_gets_a_processor_and_is_told(monkeypatch):
    """As proc(5) has it of a process that is exiting; one that never gets there is told all the same."""
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as child:
        watch = recorder._Watch(child, {})
        assert watch.trouble() == ""
        row = Path(f"/proc/{child.pid}/stat").read_bytes()
        name, fields = row[: row.rindex(b")") + 1], row[row.rindex(b")") + 1 :].split()
        fields[9 - 3] = str(int(fields[9 - 3]) | 0x4).encode()  # PF_EXITING
        given = []
        exiting = name + b" " + b" ".join(fields)
        monkeypatch.setattr(watch, "_told", lambda what: exiting if what == "stat" else b"")
        monkeypatch.setattr(recorder.os, "sched_setscheduler", lambda *arguments: given.append(arguments[:2]))
        assert watch.trouble() == ""
        assert given == [(child.pid, os.SCHED_FIFO)]
        assert watch.trouble() == ""  # its exit code says more, if it comes
        time.sleep(0.35)
        assert watch.trouble() == "the recorder has ended"
        assert len(given) == 1
        watch.close()
        child.kill()


def test_at_the_end_the_recorder_is_an_ordinary_process_again():
    """Else a busy machine lets it close its files last."""
    code = (
        "import os, sys; os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0)); print(1, flush=True); "
        "sys.stdin.read(); print(os.sched_getscheduler(0), file=sys.stderr)"
    )
    pipe = subprocess.PIPE
    with subprocess.Popen([sys.executable, "-c", code], stdin=pipe, stdout=pipe, stderr=pipe) as child:
        assert child.stdout.readline()
        assert os.sched_getscheduler(child.pid) == os.SCHED_IDLE
        assert recorder._end(child).strip() == str(os.SCHED_OTHER).encode()


def test_what_a_signal_interrupts_is_done_again(monkeypatch, tmp_path):
    """mkdir, chmod and rename, which Python does not repeat by itself."""
    for name in ("mkdir", "chmod", "replace"):
        real, calls = getattr(os, name), []

        def interrupted(*arguments, real=real, calls=calls, **more):
            calls.append(str(arguments[0]))
            if calls.count(calls[-1]) == 1:
                raise InterruptedError(4, "Interrupted system call")
            return real(*arguments, **more)

        with monkeypatch.context() as patched:
            patched.setattr(os, name, interrupted)
            folder = make_run_folder(tmp_path / name, "run")
            write_text(folder / "some.txt", "some")
        assert calls
        assert (folder / "some.txt").read_text() == "some"
        assert [path.name for path in folder.iterdir()] == ["some.txt"]


@pytest.mark.slow
def test_a_long_record_gets_its_pyramid_from_the_recorder(tmp_path: Path) -> None:
    layout = board_layout(tick_rate_Hz=1e5, axes=1, latency_ticks=1, sense_scale_V=1.0, drive_scale=1.0)
    with record_apart(tmp_path, {"capture": layout}, wait=True) as recording:
        for start in range(0, 1_200_000, 40_000):
            rows = np.zeros(40_000, layout.dtype)
            rows["tick"] = np.arange(start, start + 40_000)
            rows["vx_code"] = rows["tick"] * 7 % 1_000
            recording["capture"].push(rows)
    level = read_blocks(tmp_path / "pyramid" / "capture-256.arrow", "pyramid")
    assert level.complete
    np.testing.assert_array_equal(level.columns["tick"], np.arange(0, 1_200_000, 256))
    codes = np.arange(1_200_000) * 7 % 1_000
    starts = level.columns["tick"]
    np.testing.assert_array_equal(level.columns["vx_code_max"], np.maximum.reduceat(codes, starts))
    np.testing.assert_array_equal(level.columns["vx_code_min"], np.minimum.reduceat(codes, starts))
    assert not list((tmp_path / "pyramid").glob(".*"))


@pytest.mark.slow
def test_a_pyramid_that_cannot_be_written_costs_the_record_nothing(tmp_path: Path) -> None:
    layout = board_layout(tick_rate_Hz=1e5, axes=1, latency_ticks=1, sense_scale_V=1.0, drive_scale=1.0)
    (tmp_path / "pyramid").write_text("in the way")
    with record_apart(tmp_path, {"capture": layout}, wait=True) as recording:
        for start in range(0, 1_200_000, 40_000):
            rows = np.zeros(40_000, layout.dtype)
            rows["tick"] = np.arange(start, start + 40_000)
            recording["capture"].push(rows)
    found = read_capture(tmp_path / "capture.arrow")
    assert (len(found), found.complete) == (1_200_000, True)
