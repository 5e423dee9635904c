"""`load` in result.json: shares of a core, of loop and recorder, all over the time in which the board was driven."""

import math
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from hil.records.layout import Layout
from hil.records.timing import timing_layout
from hil.running.process.load import LoadMeter
from hil.running.recording import recorder
from hil.running.recording.recorder import record_apart

STOP_S = 0.4
BURN = "import time\nend = time.process_time() + 0.6\nwhile time.process_time() < end: pass"


def burn(seconds: float) -> None:
    """A processor for so long."""
    end = time.thread_time() + seconds
    while time.thread_time() < end:
        pass


def layouts() -> dict[str, Layout]:
    return {"timing": timing_layout(tick_rate_Hz=1e4)}


def test_what_the_recorder_did_before_and_after_is_none_of_its_share(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To start it takes a second of a core, to end it may take more: neither falls into the time measured."""
    monkeypatch.setattr(recorder, "subprocess", subprocess)  # no fork, which has loaded what it needs
    subprocess.run([sys.executable, "-c", BURN], check=True)  # another child that was waited for
    with record_apart(tmp_path, layouts()) as recording:
        began = recording.busy_s()
        meter = LoadMeter(recording.busy_s)
        time.sleep(STOP_S)
        meter.stop()
    assert began > 0.02  # it has imported what it needs
    load = meter.load()
    assert 0.0 <= load["recorder"] < 0.5, load
    assert load["loop"] < 0.5, load


def test_a_recorder_that_works_has_its_share(tmp_path: Path) -> None:
    with record_apart(tmp_path, layouts()) as recording:
        meter = LoadMeter(recording.busy_s)
        end = time.monotonic() + STOP_S
        tick = 0
        while time.monotonic() < end:
            for _ in range(200):
                recording["timing"].put(tick := tick + 1, 1, 2, 3)
            time.sleep(0.001)
        meter.stop()
    assert 0.0 < meter.load()["recorder"] <= 1.05


@pytest.mark.parametrize("threads", [0, 2])
def test_the_loop_is_the_thread_that_answers(threads: int) -> None:
    """Whatever other threads of its process do: no share is beyond one core."""
    others = [threading.Thread(target=burn, args=(0.3,)) for _ in range(threads)]
    meter = LoadMeter(lambda: 0.0)
    for other in others:
        other.start()
    burn(0.1)
    before = time.process_time()
    for other in others:
        other.join()
    meter.stop()
    load = meter.load()
    assert 0.0 < load["loop"] <= 1.0
    assert (time.process_time() - before > 0.2) == bool(threads)
    assert load["recorder"] == 0.0


def test_a_recorder_that_is_gone_has_no_share() -> None:
    meter = LoadMeter(lambda: math.nan)
    meter.stop()
    assert "recorder" not in meter.load()
