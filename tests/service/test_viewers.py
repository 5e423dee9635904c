"""Foxglove's WebSocket protocol, as its published description has it, by a client that knows nothing of the SDK.

https://github.com/foxglove/ws-protocol: serverInfo, advertise, subscribe; binary messages 0x01 with subscription,
time and data.
"""

import json
import struct
import time
from pathlib import Path

import pytest
from websockets.sync.client import connect

from tests.running.gyro import bench_file, unhurried_bench, unhurried_scenario
from tests.service.serving import serving

pytest.importorskip("foxglove", reason="the extra `viewers` is not installed")
_DATA = struct.Struct("<BIQ")


@pytest.mark.long
@pytest.mark.realtime
def test_a_viewer_sees_the_run(tmp_path: Path) -> None:
    bench_file(tmp_path / "unhurried.bench.toml", unhurried_bench(60.0, loop={"settle_s": 1.0}))
    unhurried_scenario(tmp_path / "unhurried.scenario.toml")
    with serving(tmp_path / "runs", "--foxglove", "0") as service:
        lease = service.ask("POST", "/api/lease", json={"holder": "viewer", "seconds": 300}).json()["lease"]
        headers = {"x-lease": lease}
        connecting = {"link": "pty:unhurried", "bench": "unhurried"}
        assert service.ask("POST", "/api/board/connect", json=connecting, headers=headers).status_code == 200
        started = service.ask("POST", "/api/board/start", json={}, headers=headers)
        assert started.status_code == 200, started.text
        with connect(f"ws://127.0.0.1:{service.foxglove}", subprotocols=["foxglove.sdk.v1"], max_size=None) as viewer:
            wanted = {"/capture", "/now", "/board"}
            subscribed: dict[int, str] = {}
            seen: dict[str, list[tuple[int, dict]]] = {}
            end = time.monotonic() + 60.0
            while {topic for topic, of in seen.items() if len(of) > 3} != wanted and time.monotonic() < end:
                data = viewer.recv(timeout=30)
                if isinstance(data, bytes):
                    kind, number, when = _DATA.unpack_from(data)
                    if kind == 1 and number in subscribed:
                        seen.setdefault(subscribed[number], []).append((when, json.loads(data[_DATA.size :])))
                    continue
                said = json.loads(data)
                if said["op"] == "serverInfo":
                    assert said["name"] == "gyrohil"
                    assert said["capabilities"] in ([], ["time"])  # nothing can be asked of it
                if said["op"] == "advertise":
                    new = {
                        channel["id"]: channel["topic"] for channel in said["channels"] if channel["topic"] in wanted
                    }
                    subscribed |= new
                    asked = [{"id": number, "channelId": number} for number in new]
                    viewer.send(json.dumps({"op": "subscribe", "subscriptions": asked}))
        assert set(seen) == wanted, service.ask("GET", "/api/board").text
        times = [when for when, _ in seen["/capture"]]
        assert times == sorted(times)
        for _, message in seen["/capture"]:
            assert message["vx_V_min"] <= message["vx_V"] <= message["vx_V_max"]
        when, now = seen["/now"][-1]
        assert when == pytest.approx(1e9 * now["t_s"], abs=1.0)
        assert seen["/board"][-1][1]["state"] in ("ARMED", "RUNNING")
        service.ask("POST", "/api/board/safe")
