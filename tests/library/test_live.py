"""`hil.open(bench).stream()`: a run looked at while it lasts, and SAFE on every way out (docs/safety.md)."""

import gc
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import hil
from hil.boards.emulation import emulator
from hil.records.capture import read_capture
from hil.wire.messages import SafeReason
from tests.running.gyro import bench_file, unhurried_bench, unhurried_scenario
from tests.running.processes import safe_reason, until

LONG_S = 400.0  # beyond every test, on a busy machine too


@pytest.fixture
def board(tmp_path: Path) -> Iterator[str]:
    """A board that outlives the run: 400 samples a second, served on a pty by a process of its own."""
    with emulator(unhurried_scenario(tmp_path / "unhurried.scenario.toml")) as served:
        yield served.url


def opened(url: str, out: Path, duration_s: float = LONG_S) -> hil.Live:
    return hil.open(unhurried_bench(duration_s), link=url, arm=True, out=out)


def together(blocks: list, record: str, name: str) -> np.ndarray:
    return np.concatenate([getattr(block, record)[name] for block in blocks])


@pytest.mark.slow
def test_blocks_are_the_record_in_order_none_twice_and_none_left_out(tmp_path: Path) -> None:
    live = hil.open("s-slow", link="inproc:s-slow", clock="lockstep", duration_s=10.0, out=tmp_path)
    blocks = list(live.stream())
    assert len(blocks) > 1  # how many, says how fast this process reads
    run = live.run
    for record in ("capture", "estimates", "innovation"):
        whole = getattr(run, record)
        np.testing.assert_array_equal(np.concatenate([getattr(b, record).t_s for b in blocks]), whole.t_s)
        for name in whole:
            np.testing.assert_array_equal(together(blocks, record, name), whole[name], err_msg=name)
        assert getattr(blocks[0], record).units == whole.units
    np.testing.assert_array_equal(together(blocks, "angle", "angle_u_rad"), run.angle["angle_u_rad"])
    for before, after in pairwise(blocks):
        ends = [getattr(before, record).t_s[-1] for record in ("capture", "estimates", "innovation")]
        begins = [getattr(after, r).t_s[0] for r in ("capture", "estimates", "innovation") if len(getattr(after, r))]
        assert max(ends) < min(begins)
    assert run.verdict == "good"
    with pytest.raises(hil.InputError, match="streamed once"):
        next(live.stream())


def test_nothing_begins_before_it_is_asked_for(tmp_path: Path) -> None:
    live = hil.open("s-slow", link="inproc:s-slow", clock="lockstep", out=tmp_path)
    stream = live.stream()
    with pytest.raises(hil.InputError, match="not ended"):
        _ = live.run
    stream.close()
    with live:
        pass
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_what_cannot_begin_is_raised_where_the_blocks_are_asked_for(tmp_path: Path) -> None:
    with pytest.raises(hil.InputError, match="needs arm=True"):
        hil.open("s-slow", link="serial:/dev/ttyACM0")
    live = hil.open("s-slow", link="serial:/dev/null", arm=True, out=tmp_path)
    with pytest.raises((hil.InputError, hil.WireError), match="not a serial port"):
        list(live.stream())
    with pytest.raises((hil.InputError, hil.WireError), match="not a serial port"):
        _ = live.run
    assert not list(tmp_path.iterdir())


def leave_by_break(live: hil.Live) -> None:
    for _ in live.stream():
        break


def leave_by_an_exception(live: hil.Live) -> None:
    def fail() -> None:
        for block in live.stream():
            raise ZeroDivisionError(len(block.capture))

    with pytest.raises(ZeroDivisionError):
        fail()


def leave_by_ctrl_c(live: hil.Live) -> None:
    def press() -> None:
        for _ in live.stream():
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        press()


def leave_by_the_end_of_a_with(live: hil.Live) -> None:
    with live:
        stream = live.stream()
        next(stream)
    assert list(stream) is not None


def leave_by_forgetting(live: hil.Live) -> None:
    stream = live.stream()
    next(stream)
    del stream
    gc.collect()


@pytest.mark.beyond(1)
@pytest.mark.slow
@pytest.mark.parametrize(
    "leave",
    [
        leave_by_break,
        leave_by_an_exception,
        leave_by_ctrl_c,
        leave_by_the_end_of_a_with,
        leave_by_forgetting,
    ],
)
def test_every_way_out_brings_the_board_to_safe(board: str, tmp_path: Path, leave: Callable[[hil.Live], None]) -> None:
    live = opened(board, tmp_path / "runs")
    begin = time.monotonic()
    leave(live)
    assert time.monotonic() - begin < 0.5 * LONG_S
    run = live.run
    assert run.verdict == "interrupted"
    assert run.result.parts["safety"].outcome == "good"
    assert "SAFE was confirmed" in run.result.parts["safety"].reason
    assert read_capture(run.path / "capture.arrow").complete
    assert run.report().exists()
    assert safe_reason(board) == SafeReason.INTERRUPTED


PROGRAM = """
import sys
import hil
live = hil.open({bench!r}, link={url!r}, arm=True, out={out!r})
stream = live.stream()
print(len(next(stream).capture), flush=True)
{then}
"""
THEN = {
    "the interpreter ends with the iterator kept": "",
    "sys.exit": "sys.exit(3)",
    "an exception that nobody catches": "1 / 0",
    "SIGINT": "for _ in stream: print('.', flush=True)",
    "SIGTERM": "for _ in stream: print('.', flush=True)",
    "SIGKILL": "for _ in stream: print('.', flush=True)",
}


@pytest.mark.long
@pytest.mark.parametrize("how", THEN)
def test_every_end_of_the_process_brings_the_board_to_safe(board: str, tmp_path: Path, how: str) -> None:
    bench = bench_file(tmp_path / "test.bench.toml", unhurried_bench(LONG_S))
    out = tmp_path / "runs"
    program = PROGRAM.format(bench=str(bench), url=board, out=str(out), then=THEN[how])
    host = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    assert host.stdout is not None
    try:
        assert int(host.stdout.readline()) > 0
        if how in signal.Signals.__members__:
            host.stdout.readline()
            os.kill(host.pid, signal.Signals[how])
        host.wait(0.5 * LONG_S)
    finally:
        host.kill()
        host.communicate()
    (folder,) = out.iterdir()
    killed = how in ("SIGTERM", "SIGKILL")
    if not killed:
        run = hil.load(folder)
        assert isinstance(run, hil.Run)
        assert run.verdict == "interrupted"
        assert run.result.parts["safety"].outcome == "good"
    else:  # the loop's own process is told by the kernel, and sees to the board
        until(lambda: _free(board))
    assert safe_reason(board) in (SafeReason.INTERRUPTED, SafeReason.LINK_LOST)
    assert len(read_capture(folder / "capture.arrow")) > 0


def _free(url: str) -> bool:
    """Whether nobody holds the port any more."""
    try:
        safe_reason(url)
    except hil.WireError:
        return False
    return True


@pytest.mark.long
@pytest.mark.realtime
def test_a_slow_reader_of_blocks_holds_nothing_up(board: str, tmp_path: Path) -> None:
    live = opened(board, tmp_path / "runs", duration_s=8.0)
    blocks = []
    for block in live.stream():
        if not blocks:
            with pytest.raises(hil.InputError, match="not ended"):
                _ = live.run
            assert not list((tmp_path / "runs").glob("*/result.json"))
            time.sleep(3.0)
        blocks.append(block)
    run = live.run
    assert len(blocks) >= 2
    np.testing.assert_array_equal(together(blocks, "capture", "vx_V"), run.capture["vx_V"])
    answers = run.result.answers
    assert answers is not None
    assert answers.lost_to_host == 0
    assert answers.missed < 0.5 * 3.0 * 400  # a loop that waited for the reader would have missed its three seconds
