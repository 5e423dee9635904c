"""The board of a service: lease, consent, start, SAFE, settings, who may die without it (docs/safety.md, The service).

A real service, the process that holds the board, the loop in its own, an emulated board on a pty that outlives them.
"""

import json
import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from hil.boards.emulation import emulator
from hil.records.capture import read_capture
from hil.service.board.lease import Leases
from hil.service.problems import Problem
from hil.wire.messages import SafeReason
from tests.running.gyro import bench_file, unhurried_bench, unhurried_scenario
from tests.running.processes import alive, command_line, safe_reason
from tests.service.serving import Serving, serving

# Boards follow a clock on the wall; and a service looks for a lost one under the name of its pty, which the system may
# have given to a board of other tests by then.
pytestmark = pytest.mark.realtime(alone=True)
LONG_S = 300.0
PATIENCE_S = 60.0


@pytest.fixture
def board(tmp_path: Path) -> Iterator[str]:
    """400 samples a second, on a pty, by a process that no service started."""
    with emulator(unhurried_scenario(tmp_path / "unhurried.scenario.toml")) as served:
        yield served.url


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Serving]:
    """A service beside a bench file for that board."""
    bench_file(tmp_path / "unhurried.bench.toml", unhurried_bench(LONG_S, loop={"settle_s": 1.0}))
    with serving(tmp_path / "runs") as running:
        yield running


class Operator:
    """Who has the lease."""

    def __init__(self, service: Serving, holder: str = "a person") -> None:
        self.service = service
        taken = service.ask("POST", "/api/lease", json={"holder": holder, "purpose": "a test", "seconds": 600})
        assert taken.status_code == 200, taken.text
        self.lease = taken.json()["lease"]

    def ask(self, method: str, path: str, **given: Any) -> Any:
        """One request under the lease; the answer's JSON, which must be good."""
        answer = self.service.ask(method, path, headers={"x-lease": self.lease}, **given)
        assert answer.status_code == 200, answer.text
        return answer.json()

    def run(self, link: str, **given: Any) -> Path:
        """Connect and start; the run's folder."""
        self.ask("POST", "/api/board/connect", json={"link": link, "bench": "unhurried"})
        started = self.ask("POST", "/api/board/start", json={"consent": True, **given})
        return self.service.folder / started["run"]

    @property
    def state(self) -> Any:
        return self.service.ask("GET", "/api/board").json()


def until(condition: Callable[[], Any], patience_s: float = PATIENCE_S) -> Any:
    end = time.monotonic() + patience_s
    while not (found := condition()):
        assert time.monotonic() < end
        time.sleep(0.02)
    return found


def processes(module: str, folder: Path) -> list[int]:
    """Processes of a module that belong to the service of `folder`."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit() and alive(int(entry.name)):
            try:
                words = command_line(int(entry.name))
            except OSError:
                continue
            if module in words and any(str(folder) in word for word in words):
                found.append(int(entry.name))
    return found


def keeper_of(service: Serving) -> int:
    (keeper,) = processes("hil.service.board.keeper", service.folder)
    return keeper


def loop_of(service: Serving) -> int:
    tasks = Path(f"/proc/{keeper_of(service)}/task").iterdir()  # its parent is one thread of several
    born = [int(word) for task in tasks for word in (task / "children").read_text().split()]
    return next(one for one in born if "hil.running.process.worker" in command_line(one))


# -- lease ---------------------------------------------------------------------------------------------------------


class Clock:
    now = 100.0

    def __call__(self) -> float:
        return self.now


def test_a_dead_client_cannot_keep_a_lease() -> None:
    clock = Clock()
    leases = Leases(now=clock)
    first = leases.take("Ada", "drift", 10.0, wait=False)["lease"]
    with pytest.raises(Problem, match=r"Ada has the board for 10 s more.*drift") as refused:
        leases.take("Bob", "noise", 10.0, wait=False)
    assert refused.value.status == 409
    clock.now += 9.0
    leases.renew(first)
    clock.now += 9.0
    assert leases.require(first) == "Ada"
    clock.now += 1.1
    with pytest.raises(Problem, match="nobody has the lease"):
        leases.require(first)
    with pytest.raises(Problem, match="has ended"):
        leases.renew(first)
    assert leases.take("Bob", "noise", 10.0, wait=False)["place"] == 0


def test_the_queue_is_in_order_and_forgets_the_dead() -> None:
    clock = Clock()
    leases = Leases(now=clock)
    ada = leases.take("Ada", "", 100.0, wait=False)["lease"]
    leases.take("Bob", "", 10.0, wait=True)
    cleo = leases.take("Cleo", "", 10.0, wait=True)["lease"]
    assert [one["holder"] for one in leases.told()["queue"]] == ["Bob", "Cleo"]
    clock.now += 20.0
    assert leases.renew(cleo)["place"] == 2
    clock.now += 20.0  # Bob has not renewed
    assert leases.renew(cleo)["place"] == 1
    leases.give_back(ada)
    assert leases.renew(cleo)["place"] == 0
    assert leases.require(cleo) == "Cleo"
    with pytest.raises(Problem, match="Cleo has the board"):
        leases.require(ada)


def test_nobody_overtakes_who_waits() -> None:
    clock = Clock()
    leases = Leases(now=clock)
    ada = leases.take("Ada", "", 10.0, wait=False)["lease"]
    bob = leases.take("Bob", "", 10.0, wait=True)["lease"]
    leases.give_back(ada)
    with pytest.raises(Problem, match="Bob"):
        leases.take("Cleo", "", 10.0, wait=False)
    assert leases.renew(bob)["place"] == 0


# -- the board ---------------------------------------------------------------------------------------------------


def test_without_the_lease_and_without_consent_nothing_is_armed(bench: Serving, board: str) -> None:
    connect = {"link": board, "bench": "unhurried"}
    assert bench.ask("POST", "/api/board/connect", json=connect).status_code == 409
    operator = Operator(bench, "Ada")
    refused = bench.ask("POST", "/api/board/connect", json=connect, headers={"x-lease": "mine"})
    assert refused.status_code == 409
    assert "Ada" in refused.json()["error"]
    state = operator.ask("POST", "/api/board/connect", json=connect)
    assert state["connected"]
    assert state["state"] == "SAFE"
    assert state["identity"]["tick_rate_Hz"] == 400.0
    assert not state["emulated"]  # a pty may lead anywhere
    for body in ({}, {"consent": False}):
        refused = bench.ask("POST", "/api/board/start", json=body, headers={"x-lease": operator.lease})
        assert refused.status_code == 409
        assert "arm" in refused.json()["error"]
    yes = bench.ask("POST", "/api/board/start", json={"consent": "yes"}, headers={"x-lease": operator.lease})
    assert yes.status_code == 422
    assert operator.state["run"] is None
    assert safe_reason_of(operator, board) is SafeReason.LINK_LOST  # never armed by anybody


def safe_reason_of(operator: Operator, board: str) -> SafeReason:
    """Why the board is SAFE, by what it says to another host, once the service has let it go."""
    operator.ask("POST", "/api/board/disconnect")
    return safe_reason(board)


def test_start_settings_safe(bench: Serving, board: str) -> None:
    operator = Operator(bench)
    folder = operator.run(board, note="by a test")
    until(lambda: operator.state["state"] == "RUNNING")
    again = bench.ask("POST", "/api/board/start", json={"consent": True}, headers={"x-lease": operator.lease})
    assert again.status_code == 409
    begun_with = operator.state["settings"]
    headers = {"x-lease": operator.lease}
    refused = [({"dither": -1.0}, 422), ({"amplitude": 0}, 422), ({"nonsense": 1.0}, 422), ({"dither": "x"}, 422)]
    for body, status in [*refused, ({"virtual_rotation": 1e6}, 400)]:
        assert bench.ask("PATCH", "/api/board/settings", json=body, headers=headers).status_code == status
    assert operator.state["settings"] == begun_with
    said = operator.ask("PATCH", "/api/board/settings", json={"virtual_rotation": 0.5, "amplitude": 1e-3})
    assert said["at_once"] == {"virtual_rotation": 0.5}
    assert "amplitude" in said["at_next_start"]
    until(lambda: operator.state["settings"].get("virtual_rotation") == 0.5)
    time.sleep(1.0)
    safe = bench.ask("POST", "/api/board/safe").json()  # without the lease
    assert safe["confirmed"] is True
    assert safe["ms"] < 1000.0
    until(lambda: operator.state["run"] is None)
    assert operator.state["last_run"] == folder.name
    assert operator.state["reason"] == "INTERRUPTED"
    result = json.loads((folder / "result.json").read_text())
    assert result["verdict"] == "interrupted"
    assert result["operator_note"] == "by a test"
    assert result["parts"]["safety"]["outcome"] == "good"
    capture = read_capture(folder / "capture.arrow")
    assert capture.complete
    (change,) = [json.loads(line) for line in (folder / "changes.jsonl").read_text().splitlines()]
    assert change["virtual_rotation"] == 0.5
    assert 0 < change["tick"] < capture.ends[1]
    audit = [entry["what"] for entry in bench.ask("GET", "/api/audit").json()]
    assert audit[:2] == ["run ended", "safe"]
    assert {"lease", "connect", "start", "settings"} <= set(audit)
    assert safe_reason_of(operator, board) is SafeReason.INTERRUPTED


@pytest.mark.slow
def test_the_service_dies_and_the_loop_does_not_notice(tmp_path: Path, board: str) -> None:
    bench_file(tmp_path / "unhurried.bench.toml", unhurried_bench(LONG_S, loop={"settle_s": 1.0}))
    with serving(tmp_path / "runs") as first:
        operator = Operator(first)
        folder = operator.run(board)
        until(lambda: operator.state["state"] == "RUNNING")
        loop = loop_of(first)
        first.process.send_signal(signal.SIGKILL)
        first.process.wait()
        before = (folder / "capture.arrow").stat().st_size
        time.sleep(2.0)
        assert alive(loop)
        assert (folder / "capture.arrow").stat().st_size > before
    with serving(tmp_path / "runs") as second:  # which finds the board again
        state = second.ask("GET", "/api/board").json()
        assert (state["run"], state["bench"]) == (folder.name, "unhurried")
        assert second.ask("POST", "/api/board/safe").json()["confirmed"] is True
        until(lambda: second.ask("GET", "/api/board").json()["run"] is None)
        capture = read_capture(folder / "capture.arrow")
        assert capture.complete
        first_tick, last_tick = capture.ends
        assert len(capture) == last_tick - first_tick + 1 - json.loads((folder / "result.json").read_text())["lost"]
    assert not alive(loop)
    until(lambda: not processes("hil.service.board.keeper", tmp_path))


@pytest.mark.long
def test_sigterm_brings_the_board_to_safe_and_closes_the_record(tmp_path: Path, board: str) -> None:
    bench_file(tmp_path / "unhurried.bench.toml", unhurried_bench(LONG_S, loop={"settle_s": 1.0}))
    with serving(tmp_path / "runs") as running:
        operator = Operator(running)
        folder = operator.run(board)
        until(lambda: operator.state["state"] == "RUNNING")
        loop = loop_of(running)
        time.sleep(1.0)
    assert not alive(loop)
    assert not processes("hil.service.board.keeper", tmp_path)
    assert read_capture(folder / "capture.arrow").complete
    assert json.loads((folder / "result.json").read_text())["parts"]["safety"]["outcome"] == "good"
    assert safe_reason(board) is SafeReason.INTERRUPTED


@pytest.mark.long
def test_a_loop_that_is_killed_leaves_a_board_in_safe_and_a_record(bench: Serving, board: str) -> None:
    operator = Operator(bench)
    folder = operator.run(board)
    until(lambda: operator.state["state"] == "RUNNING")
    time.sleep(1.0)
    os.kill(loop_of(bench), signal.SIGKILL)
    until(lambda: operator.state["run"] is None)
    assert operator.state["words"]
    assert operator.state["connected"]
    assert len(read_capture(folder / "capture.arrow")) > 0
    assert operator.state["state"] == "SAFE"
    assert safe_reason_of(operator, board) in (SafeReason.WATCHDOG, SafeReason.LINK_LOST)


@pytest.mark.long
def test_who_holds_the_board_is_killed_and_the_loop_brings_it_to_safe(bench: Serving, board: str) -> None:
    operator = Operator(bench)
    folder = operator.run(board)
    until(lambda: operator.state["state"] == "RUNNING")
    loop = loop_of(bench)
    os.kill(keeper_of(bench), signal.SIGKILL)
    until(lambda: not operator.state["connected"])
    until(lambda: not alive(loop))
    assert safe_reason(board) in (SafeReason.INTERRUPTED, SafeReason.WATCHDOG)
    capture = until(lambda: read_capture(folder / "capture.arrow"))
    assert not capture.complete
    assert operator.run(board) != folder  # and the service goes on


def test_a_lost_board_is_told_within_a_second_and_comes_back(bench: Serving, tmp_path: Path) -> None:
    operator = Operator(bench)
    scenario = unhurried_scenario(tmp_path / "other.scenario.toml")
    state = operator.ask("POST", "/api/board/connect", json={"link": f"pty:{scenario.name}", "bench": "unhurried"})
    assert state["emulated"]
    (emulated,) = processes("device_emulator", scenario)
    os.kill(emulated, signal.SIGKILL)
    until(lambda: operator.state["lost"], 1.5)
    assert operator.state["state"] == "LOST"
    until(lambda: not operator.state["lost"])
    started = operator.ask("POST", "/api/board/start", json={"duration_s": 3.0})  # started here: needs no consent
    until(lambda: operator.state["run"] is None)
    assert operator.state["last_run"] == started["run"]
    operator.ask("POST", "/api/board/disconnect")
    until(lambda: not processes("device_emulator", scenario))
