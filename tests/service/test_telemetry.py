"""The live connection (docs/reference/service.md): what is sent is what is recorded, and who is slow costs nothing.

A real service, a real WebSocket, and a run with an emulated board on a pty; frames are compared with the record.
"""

import json
import os
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy import signal
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from hil.boards.emulation import emulator
from hil.records.capture import read_capture
from hil.records.frame import Frame
from hil.records.layout import TICK, Column, Layout
from hil.running.recording.ring import Ring
from hil.service.telemetry.hub import Hub
from hil.service.telemetry.views import AskSpectrum, History, Roll, SpectrumView, Tracks
from tests.running.gyro import bench_file, unhurried_bench, unhurried_scenario
from tests.service.live_client import live
from tests.service.serving import Serving, serving

pytestmark = pytest.mark.realtime  # of a board that follows a clock on the wall
RATE_HZ = 400.0


# -- decimation ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("step", [1, 3, 64])
def test_buckets_are_those_of_the_rows_however_they_come(step: int) -> None:
    random = np.random.default_rng(step)
    ticks = np.flatnonzero(random.random(5000) > 0.2)  # with gaps
    values = random.normal(size=len(ticks)).astype(np.float32)
    roll = Roll(step, 200)
    for part in np.array_split(np.arange(len(ticks)), np.sort(random.integers(0, len(ticks), 40))):
        roll.add(ticks[part], values[part])
    stop = roll.next
    assert stop == ticks[-1] // step
    first = max(stop - 200, 0)
    low, high = roll.between(first, stop)
    for k in range(stop - first):
        of_bucket = values[(ticks // step) == first + k]
        if len(of_bucket):
            assert (low[k], high[k]) == (of_bucket.min(), of_bucket.max())
        else:
            assert np.isnan(low[k])
            assert np.isnan(high[k])


def test_a_history_keeps_the_newest_and_does_not_grow() -> None:
    kept = History(np.dtype([("n", "<i8")]), 100)
    at = 0
    for count in (1, 99, 100, 101, 250, 3, 0, 60, 60, 60):
        rows = np.arange(at, at + count).astype(kept.newest(0).dtype)
        kept.add(rows)
        at += count
        np.testing.assert_array_equal(kept.newest(100)["n"], np.arange(max(at - 100, 0), at))
    assert kept.added == at
    assert len(kept.newest(10_000)) <= 200


def test_a_run_that_ends_after_its_rings_were_let_go_is_no_fault() -> None:
    """As when the service ends: it looks no more, and then hears that the run has ended."""
    layout = Layout("innovation", (TICK, Column("nu_x_V", "f4", "V")), 64, {"tick_rate_Hz": RATE_HZ})
    name = f"test-{os.getpid()}-let-go"
    with Ring.create(name, layout.dtype, 64) as ring:
        hub = Hub()
        hub.attach("innovation", json.loads(layout.to_json()), os.open(ring.path, os.O_RDONLY))
        ring.unlink()
        hub.detach()
        hub.end()
        hub.look()
    assert not hub.live


def test_a_spectrum_is_welchs() -> None:
    rate, count = 1000.0, 1 << 15
    layout = Layout("innovation", (TICK, Column("nu_x_V", "f4", "V")), 64, {"tick_rate_Hz": rate})
    ring = Ring.create(f"{os.getpid()}-{time.monotonic_ns()}-spectrum", layout.dtype, 1 << 16)
    tracks = Tracks()
    try:
        descriptor = os.open(ring.path, os.O_RDONLY)
        tracks.add("innovation", json.loads(layout.to_json()), descriptor)
        os.close(descriptor)
        t = np.arange(count) / rate
        values = 0.3 * np.sin(2 * np.pi * 123.0 * t) + np.random.default_rng(1).normal(0.0, 0.1, count)
        rows = np.empty(count, layout.dtype)
        rows["tick"], rows["nu_x_V"] = np.arange(count), values
        ring.push(rows)
        tracks.look()
        frame = SpectrumView(AskSpectrum(op="spectrum", id=1, channel="innovation.nu_x_V"), tracks).frame(tracks)
    finally:
        tracks.close()
        ring.unlink()
        ring.detach()
    assert frame is not None
    frequency, density = signal.welch(values.astype(np.float32), rate, "hann", 4096)
    assert frame.step_s == pytest.approx(frequency[1])
    np.testing.assert_allclose(frame.high[0], np.sqrt(density), rtol=1e-3)


# -- a run -----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Serving]:
    """A service whose board is driven, for as long as the tests take."""
    place = tmp_path_factory.mktemp("live")
    bench_file(place / "unhurried.bench.toml", unhurried_bench(600.0, loop={"settle_s": 1.0}))
    with emulator(unhurried_scenario(place / "u.scenario.toml")) as board, serving(place / "runs") as service:
        service.lease = service.ask("POST", "/api/lease", json={"holder": "tests", "seconds": 600}).json()["lease"]
        headers = {"x-lease": service.lease}
        connecting = {"link": board.url, "bench": "unhurried"}
        assert service.ask("POST", "/api/board/connect", json=connecting, headers=headers).status_code == 200
        started = service.ask("POST", "/api/board/start", json={"consent": True}, headers=headers)
        assert started.status_code == 200, started.text
        service.run = started.json()["run"]
        yield service


def together(frames: list[Frame]) -> tuple[int, np.ndarray, np.ndarray]:
    """First serial number, lowest and highest of frames that follow each other."""
    for before, after in pairwise(frames):
        assert after.first == before.first + before.buckets
        assert after.begin_s == pytest.approx(before.begin_s + before.buckets * before.step_s)
    return frames[0].first, np.hstack([f.low for f in frames]), np.hstack([f.high for f in frames])


def recorded(service: Serving, until_tick: int) -> tuple[np.ndarray, np.ndarray]:
    """Ticks and sensed voltages on the disk, once they have come so far."""
    end = time.monotonic() + 20.0
    while True:
        capture = read_capture(service.folder / service.run / "capture.arrow")
        if len(capture) and capture.tick[-1] >= until_tick:
            return np.asarray(capture.tick), np.asarray(capture.sense_V)
        assert time.monotonic() < end
        time.sleep(0.2)


def test_what_is_sent_is_what_is_recorded(running: Serving) -> None:
    channels = ["capture.vx_V", "capture.vy_V"]
    with live(running) as client:
        client.say(op="subscribe", id=3, channels=channels, window_s=1.0, points=400)
        client.say(op="subscribe", id=4, channels=channels[:1], window_s=8.0, points=100)
        frames: dict[int, list[Frame]] = {3: [], 4: []}
        while len(frames[3]) < 30 or len(frames[4]) < 8:
            received = client.receive()
            if isinstance(received, Frame):
                frames[received.id].append(received)
    assert frames[3][0].step_s == 1.0 / RATE_HZ
    assert frames[4][0].step_s == 32 / RATE_HZ
    first, low, high = together(frames[3])
    np.testing.assert_array_equal(low, high)  # single samples
    ticks, sense = recorded(running, first + low.shape[1])
    at = np.searchsorted(ticks, np.arange(first, first + low.shape[1]))
    np.testing.assert_allclose(low.T, sense[at], rtol=1e-6)
    first, low, high = together(frames[4])
    ticks, sense = recorded(running, 32 * (first + low.shape[1]))
    for k in range(low.shape[1]):
        of_bucket = sense[ticks // 32 == first + k, 0]
        assert (low[0, k], high[0, k]) == pytest.approx((of_bucket.min(), of_bucket.max()), rel=1e-6)
    assert np.max(high - low) > 0.0


def test_a_trigger_holds_the_picture_still(running: Serving) -> None:
    with live(running) as client:
        trigger = {"channel": "capture.vy_V", "level": 0.0, "edge": "fall"}
        client.say(op="subscribe", id=1, channels=["capture.vy_V"], window_s=0.25, mode="trigger", trigger=trigger)
        seen = [client.frame(1) for _ in range(5)]
    for frame in seen:
        assert frame.buckets == 100
        values = frame.low[0]
        assert values[20] < 0.0 <= values[19]  # a fifth of the window lies before it
    assert len({frame.begin_s for frame in seen}) == 5
    assert all(after.first > before.first for before, after in pairwise(seen))


@pytest.mark.long
def test_the_pattern_is_the_newest_periods_of_both_axes(running: Serving) -> None:
    with live(running) as client:
        client.say(op="pattern", id=2, periods=3)
        client.frame(2)
        time.sleep(0.5)
        frame = client.frame(2)
    assert frame.low.shape == (2, 60)  # three periods of 20 Hz
    ticks, sense = recorded(running, frame.first + 60)
    at = int(np.searchsorted(ticks, frame.first))
    np.testing.assert_allclose(frame.low.T, sense[at : at + 60], rtol=1e-6)


def test_the_state_says_how_the_run_fares_ten_times_a_second_at_most(running: Serving) -> None:
    with live(running) as client:
        begin = time.monotonic()
        states = [client.message("state") for _ in range(15)]
        assert time.monotonic() - begin > 1.2
    now = states[-1]["now"]
    assert states[-1]["run"] == running.run
    assert states[-1]["state"] == "RUNNING"
    assert now["t_s"] > states[0]["now"]["t_s"]
    assert set(now["estimates"]) >= {"x_m", "rate_rad_s", "kxx_per_s2", "dxy_per_s"}
    assert len(now["estimates"]) == 13
    value, sd, unit = now["estimates"]["rate_rad_s"]
    assert (value, sd, unit) == (now["rate_rad_s"], now["rate_u"], "rad/s")
    assert now["angle_u_rad"] > 0.0
    assert 0.0 < now["drive"]["peak_x"] <= now["drive"]["full_scale"]
    health = states[-1]["health"]
    assert health["samples"] > 0
    assert health["silent_s"] < 1.0
    assert 0.0 <= health["in_time"] <= 1.0


@pytest.mark.long
def test_who_does_not_read_loses_the_oldest_and_takes_no_memory(running: Serving) -> None:
    def resident() -> int:
        pages = Path(f"/proc/{running.process.pid}/statm").read_text().split()[1]
        return int(pages) * os.sysconf("SC_PAGE_SIZE")

    wanted = {"op": "subscribe", "channels": ["capture.vx_V"] * 16, "window_s": 5.0, "points": 2000}
    with live(running, max_queue=1) as slow, live(running) as quick:
        for number in range(20):
            slow.say(id=number, **wanted)
        quick.say(op="subscribe", id=1, channels=["capture.vx_V"], window_s=1.0)
        quick.frame(1)
        before, heard = resident(), 0
        end = time.monotonic() + 2.0
        while time.monotonic() < end:
            quick.frame(1)
            heard += 1
        assert heard > 20  # who is quick is served as ever
        assert resident() - before < 20e6
        newest = quick.frame(1)
        while (late := slow.frame(19)).begin_s + late.buckets * late.step_s < newest.begin_s - 1.0:
            pass  # what was under way
        assert late.buckets > 0


def test_what_is_no_request_is_refused_and_the_connection_stays(running: Serving) -> None:
    with live(running) as client:
        for text in ("", "x", "[]", "7", "{}", '{"op": "no"}', '{"op": "subscribe"}', '{"op": "subscribe", "id": -1}'):
            client.socket.send(text)
            assert client.message("error")["error"]
        for given in (
            {"channels": ["capture.nothing"]},
            {"channels": []},
            {"channels": ["capture.vx_V"], "points": 10**9},
            {"channels": ["capture.vx_V"], "window_s": -1.0},
            {"channels": ["capture.vx_V"], "mode": "trigger"},
            {"channels": ["capture.vx_V"], "extra": 1},
        ):
            client.say(op="subscribe", id=5, **given)
            error = client.message("error")
            assert error["id"] == 5
            assert "\n" not in error["error"]
        for number in range(40):
            client.say(op="subscribe", id=number, channels=["capture.vx_V"])
        assert "subscriptions" in client.message("error")["error"]
        client.say(op="unsubscribe", id=0)
        client.say(op="spectrum", id=0, channel="innovation.nu_x_V")
        assert client.frame(0).buckets > 10
        client.say(op="nonsense")
        client.message("error")


def _closing_code(service: Serving, message: str) -> int:
    with connect(f"ws://{service.address}/api/live") as socket:
        socket.send(message)
        with pytest.raises(ConnectionClosed) as closed:
            socket.recv(timeout=20)
    assert closed.value.rcvd is not None
    return closed.value.rcvd.code


def test_without_a_valid_token_nothing_is_told(running: Serving) -> None:
    for message in (
        json.dumps({"op": "hello", "token": "x"}),
        json.dumps({"op": "hello"}),
        json.dumps({"op": "safe", "token": running.token()}),
        "no json",
        json.dumps([running.token()]),
    ):
        assert _closing_code(running, message) == 4401


def test_another_sites_page_cannot_connect(running: Serving) -> None:
    for options in ({"origin": "http://evil.example"}, {"additional_headers": {"Host": "evil.example"}}):
        with pytest.raises(InvalidStatus) as refused, connect(f"ws://{running.address}/api/live", **options):
            pass
        assert refused.value.response.status_code in (400, 403)
    with live(running, origin=f"http://{running.address}") as client:
        client.message("state")


def test_safe_over_the_live_connection(running: Serving) -> None:
    """The last test of the run: it ends it."""
    with live(running) as client:
        client.say(op="subscribe", id=1, channels=["capture.vx_V"], window_s=0.5)
        client.frame(1)
        client.say(op="safe")
        said = client.message("safe")
        assert said["confirmed"] is True
        assert isinstance(said["tick"], int)
        while (state := client.message("state"))["stage"] == "run":
            pass
        assert state["state"] == "SAFE"
    capture = read_capture(running.folder / running.run / "capture.arrow")
    assert capture.complete
    assert capture.tick[-1] >= said["tick"] - 2
