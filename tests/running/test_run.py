"""`hil.running.run.run`: what a run leaves behind, and what is refused before there is one."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from hil.bench import Bench
from hil.boards.emulation import emulator
from hil.errors import InputError
from hil.progress import Progress, untold
from hil.records.capture import read_capture
from hil.records.runfolder import RunFolder
from hil.records.truth import read_truth
from hil.running.process.start import worker_process
from hil.running.request import RunRequest
from hil.running.run import RunResult, run
from hil.wire.errors import LinkClosed, LinkError, ProtocolError
from hil.wire.messages import SafeReason
from hil.wire.pty_link import open_pty
from hil.wire.spec import SPEC
from tests.running import gyro
from tests.running.processes import safe_reason
from tests.wire.board import SmallBoard

pytestmark = pytest.mark.usefixtures("no_report")


def go(declared: Bench, link: str, out: Path, *, dry_run: bool = False) -> RunResult:
    return run(RunRequest(declared, link, dry_run=dry_run), out, progress=untold)


@contextmanager
def served(board: SmallBoard) -> Iterator[str]:
    """A little board behind a pty, for as long as one host stays connected."""
    link = open_pty()

    def serve() -> None:
        try:
            while True:
                link.send(board.exchange(link.receive(None)))
        except LinkClosed:
            return

    server = threading.Thread(target=serve)
    server.start()
    yield f"serial:{link.path}"
    server.join()
    link.close()


def refused(kind: type[Exception], declared: Bench, link: str, out: Path) -> str:
    """The one line with which a run is refused, without anything left of it."""
    with pytest.raises(kind) as caught:
        go(declared, link, out)
    assert list(out.iterdir()) == []
    message = str(caught.value)
    assert "\n" not in message
    return message


@pytest.mark.slow
def test_a_run_leaves_its_records_and_their_verdict(tmp_path: Path) -> None:
    stages: list[Progress] = []
    scenario = gyro.scenario(tmp_path / "board.toml")
    declared = gyro.bench(3.0, loop={"name": "first"})
    done = run(
        RunRequest(declared, f"inproc:{scenario}", {"note": "by hand"}), tmp_path / "runs", progress=stages.append
    )
    assert done.folder is not None
    folder = RunFolder(done.folder)
    result = folder.result
    assert result is not None
    assert (result.verdict, result.reasons, result.complete) == ("good", (), True)
    assert (result.samples, result.lost, result.late, result.clock) == (12000, 0, 0, "lockstep")
    assert result.operator_note == "by hand"
    assert result.serial_number == f"{0x5107:016x}"
    assert result.counters["samples"] == 12000
    assert folder.capture is not None
    assert folder.capture.complete
    assert {stage for stage, *_ in stages} == {"connect", "prepare", "run", "scan", "report"}
    assert max(report.done for report in stages if report.stage == "run") == 12000


@pytest.mark.slow
def test_with_the_loop_open_nothing_is_driven(tmp_path: Path) -> None:
    """And a ring-down is no fault: the verdict asks for no energy that nobody puts in, and judges no angle."""
    scenario = gyro.scenario(tmp_path / "board.toml")
    done = go(gyro.bench(2.0, controller={"enabled": False}), f"inproc:{scenario}", tmp_path / "runs")
    assert done.folder is not None
    folder = RunFolder(done.folder)
    assert folder.capture is not None
    assert folder.estimates is not None
    assert folder.result is not None
    assert not folder.capture.drive.any()
    assert folder.estimates["energy_ratio"][-1] < 0.2
    assert (folder.result.verdict, folder.result.reasons) == ("good", ())
    assert {name: part.outcome for name, part in folder.result.parts.items()} == {
        "safety": "good", "machine": "good", "model": "complete", "angle": "unknown",
    }  # fmt: skip
    assert folder.bench["controller"]["enabled"] is False  # the bench as run


@pytest.mark.slow
def test_a_dry_run_does_not_arm(tmp_path: Path) -> None:
    truth = tmp_path / "truth.arrow"
    with emulator(gyro.scenario(tmp_path / "board.toml"), truth=truth) as board:
        done = go(gyro.bench(clock="paced"), board.url, tmp_path / "runs", dry_run=True)
    assert done.folder is None
    assert done.identity["tick_rate_Hz"] == gyro.RATE_HZ
    assert not (tmp_path / "runs").exists()
    assert read_truth(truth).tick.size == 0  # not one tick has passed on the board


@pytest.mark.slow
def test_a_watcher_that_fails_leaves_no_board_driven(tmp_path: Path) -> None:
    def fail(progress: Progress) -> None:
        if progress.done > 600:
            raise ZeroDivisionError

    with emulator(gyro.unhurried_scenario(tmp_path / "board.toml")) as board:
        with pytest.raises(ZeroDivisionError):
            run(RunRequest(gyro.unhurried_bench(60.0), board.url), tmp_path / "runs", progress=fail)
        assert safe_reason(board.url) == SafeReason.INTERRUPTED
    (folder,) = (tmp_path / "runs").iterdir()
    assert read_capture(folder / "capture.arrow").complete


@pytest.mark.slow
def test_another_protocol_is_refused(tmp_path: Path) -> None:
    with served(SmallBoard(protocol=SPEC.protocol + 1)) as link:
        message = refused(ProtocolError, gyro.bench(), link, tmp_path / "runs")
    numbers = f"{link}: the board speaks protocol {SPEC.protocol + 1}, this host {SPEC.protocol}; spec hash"
    assert message.startswith(numbers)
    assert message.endswith("; update the host (docs/reference/wire-changes.md)")


@pytest.mark.slow
def test_another_spec_is_refused_by_its_first_difference(tmp_path: Path) -> None:
    board = SmallBoard(spec_hash=SPEC.hash ^ 1)
    at, entry = next((at, entry) for at, entry in enumerate(SPEC.table) if entry.field == "vx")
    board.table = (*SPEC.table[:at], entry._replace(type="f32"), *SPEC.table[at + 1 :])
    with served(board) as link:
        message = refused(ProtocolError, gyro.bench(), link, tmp_path / "runs")
    assert message.startswith(f"{link}: spec hash {SPEC.hash ^ 1:#010x} on the board, {SPEC.hash:#010x} here: ")
    assert "SENSE" in message
    assert "vx" in message
    assert "f32" in message
    assert message.endswith("; build both from one spec.toml")


@pytest.mark.slow
def test_a_board_that_refuses_to_be_armed(tmp_path: Path) -> None:
    """Without latency there is no time for an answer on wall time."""
    scenario = gyro.scenario(tmp_path / "board.toml", drive={"latency_samples": 0})
    with emulator(scenario) as board:
        message = refused(ProtocolError, gyro.bench(clock="paced"), board.url, tmp_path / "runs")
    assert message.startswith(f"{board.url}: the board refused ARM: NOT_SUPPORTED; it cannot run like this")


@pytest.mark.slow
def test_no_board_behind_the_port(tmp_path: Path) -> None:
    declared = gyro.bench(link={"timeout_s": 0.2})
    link = open_pty()
    message = refused(LinkError, declared, f"serial:{link.path}", tmp_path / "runs")
    link.close()
    assert message.startswith(f"serial:{link.path}: no answer to HELLO")


@pytest.mark.slow
@pytest.mark.realtime
def test_a_wild_record_brings_the_board_to_safe(tmp_path: Path) -> None:
    scenario = gyro.unhurried_scenario(tmp_path / "board.toml")
    declared = gyro.unhurried_bench(
        10.0, device={"sense": {"gain_V_per_m": (885.42, -885.42)}}, limits={"residual_safe": 100.0}
    )
    with emulator(scenario) as board:
        done = go(declared, board.url, tmp_path / "runs")
        assert safe_reason(board.url) == SafeReason.RESIDUAL
    assert done.folder is not None
    result = RunFolder(done.folder).result
    assert result is not None
    assert result.verdict == "interrupted"
    assert result.reasons[0].startswith("the innovation exceeded [limits] residual_safe = 100 × the noise; ")
    assert "the drive of x acts the wrong way round" in result.reasons[0]
    assert result.counters["residual_safe"] == 1
    assert result.samples < 4000
    assert result.complete


def test_a_board_that_does_not_start_leaves_no_process_of_the_loop(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The loop's process gets ready while the board does, and is started before it."""
    started = []

    @contextmanager
    def noted(*arguments: Any) -> Iterator[Any]:
        with worker_process(*arguments) as worker:
            started.append(worker)
            yield worker

    monkeypatch.setattr("hil.running.run.worker_process", noted)
    (tmp_path / "broken.toml").write_text("no scenario\n")
    with pytest.raises(InputError, match=r"broken\.toml"):
        go(gyro.bench(1.0, "paced"), f"pty:{tmp_path}/broken.toml", tmp_path / "runs")
    (worker,) = started
    assert worker.returncode is not None
