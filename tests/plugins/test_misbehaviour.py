"""Plug-ins that misbehave while a board is driven: SAFE, the plug-in named, the record whole."""

import json
import os
import subprocess
import sys
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from hil.bench import Bench, override
from hil.errors import InputError
from hil.plugins.native import HEADER
from hil.records.check import check
from hil.records.runfolder import RunFolder
from hil.running.process.supervision import _Followed
from hil.running.safety.latching import Safety
from hil.wire.errors import WireError
from tests.plugins.compiled import STRICT
from tests.plugins.misbehaving import AFTER
from tests.plugins.running import HERE, bench, ran
from tests.running import gyro
from tests.running.processes import Host

pytestmark = [pytest.mark.usefixtures("no_report"), pytest.mark.slow]

SHORT: dict[str, dict[str, Any]] = {"link": {"timeout_s": 0.5}, "loop": {"estimate_every": 8}}
PATIENT: dict[str, dict[str, Any]] = {"link": {"timeout_s": 5.0}, "loop": {"estimate_every": 8}}


class Wrong(NamedTuple):
    """What a plug-in does, where, and what is said of it."""

    place: str
    words: str


IN_PYTHON = {
    "Raises": Wrong("observer", "observe raised RuntimeError: lost lock, misbehaving.py line"),
    "NanState": Wrong("observer", "vx is nan; it must be a finite number"),
    "NanRate": Wrong("observer", "rate is nan"),
    "InfiniteAngle": Wrong("observer", "angle is inf"),
    "InfiniteConstant": Wrong("observer", "kxx is -inf"),
    "NegativeUncertainty": Wrong("observer", "angle_u is -1"),
    "NegativeDeviation": Wrong("observer", "the deviation of rate is -0.001; it must be zero or more"),
    "NegativeInnovationDeviation": Wrong("observer", "innovation_deviation on y is -1; it must be zero or more"),
    "Absurd": Wrong("observer", "x is 1e+300, a billion times what the declared device has"),
    "AbsurdConstant": Wrong("observer", "kxx is 1e+300, a billion times"),
    "Holds": Wrong("observer", "its motion has not changed over 100 periods"),
    "UnknownName": Wrong("observer", "constants has 'stiffness', known are x, vx,"),
    "WrongShape": Wrong("observer", "x is ndarray of shape (2,), a number is expected"),
    "NoEstimate": Wrong("observer", "observe gave a NoneType, hil.Estimate is expected"),
    "NanDrive": Wrong("controller", "the drive on x is nan"),
    "BeyondLimit": Wrong("controller", "the drive on y is -10.0097 m/s², the limit is ± 9.99969"),
    "ThreeForces": Wrong("controller", "control gave a list, hil.Drive or two numbers are expected"),
    "Blocks": Wrong("observer", "it did not come back within 1 s"),
    "Swallows": Wrong("controller", "it did not come back within 1 s"),
    "Sleeps": Wrong("observer", "it took 0.7"),
    "Crashes": Wrong("observer", "it crashed (SIGSEGV)"),
    "Aborts": Wrong("controller", "it crashed (SIGABRT)"),
    "Exits": Wrong("observer", "observe raised SystemExit: 0"),
    "ExitsAtOnce": Wrong("observer", "the loop's process ended with code 0, with [observer] plugin"),
    "Allocates": Wrong("observer", "observe raised MemoryError"),
    "Leaks": Wrong("observer", "this process has grown by"),
}

IN_C = {
    "NAN_STATE": Wrong("observer", "vx is nan"),
    "NAN_DRIVE": Wrong("both", "the drive on x is nan"),
    "NEGATIVE_DEVIATION": Wrong("observer", "the deviation of rate is -0.001; it must be zero or more"),
    "INFINITE_ANGLE": Wrong("observer", "angle is inf"),
    "BEYOND": Wrong("both", "the drive on y is 10.0097 m/s², the limit is ± 9.99969"),
    "BLOCKS": Wrong("observer", "it did not come back within 1 s"),
    "SLEEPS": Wrong("observer", "it took 0.7"),
    "CRASHES": Wrong("observer", "it crashed (SIGSEGV)"),
    "ABORTS": Wrong("observer", "it crashed (SIGABRT)"),
    "DIVIDES": Wrong("observer", "it crashed (SIGFPE)"),
    "EXITS": Wrong("observer", "it ended the loop's process (exit)"),
    "EXITS_AT_ONCE": Wrong("observer", "the loop's process ended with code 0, with [observer] plugin"),
    "ALLOCATES": Wrong("observer", "it crashed (SIGSEGV)"),
    "WRITES_BEHIND": Wrong("observer", "it wrote beyond the memory that it was lent"),
    "WRITES_BEFORE": Wrong("observer", "it wrote beyond the memory that it was lent"),
    "WRITES_BEHIND_ESTIMATE": Wrong("observer", "it wrote beyond the memory that it was lent"),
    "RECURSES": Wrong("observer", "it crashed (SIGSEGV)"),
    "KILLS": Wrong("observer", "the loop's process was killed by SIGKILL, with [observer] plugin"),
}


def library(place: Path, wrong: str, *options: str) -> str:
    made = place / f"{wrong.lower()}.so"
    command = ["cc", *STRICT, "-Wno-infinite-recursion", f"-I{HEADER.parent}", f"-DWRONG={wrong}", *options]
    subprocess.run([*command, "-o", made, HERE / "misbehaving.c", "-lm"], check=True)
    return str(made)


def with_plugin(name: str, wrong: Wrong) -> Bench:
    observer = name if wrong.place in ("observer", "both") else None
    controller = name if wrong.place in ("controller", "both") else None
    takes_long = "memory" in wrong.words.lower() or "allocates" in name
    return bench(observer, controller, changes=PATIENT if takes_long else SHORT)


def is_stopped_and_named(run: RunFolder, name: str, words: str) -> None:
    """The board is SAFE, and every sample that was answered is in the record."""
    result = run.result
    assert result is not None
    assert result.verdict == "interrupted"
    safety = result.parts["safety"]  # in lockstep an emulated board ends with the process that drove it
    assert safety.outcome == "good" or (safety.outcome == "failed" and safety.reason in result.reasons)
    told = "; ".join(result.reasons)
    assert words in told
    assert f"plugin {name.rpartition('/')[2]}" in told
    assert "\n" not in told
    capture = run.capture
    assert capture is not None
    assert len(capture) >= AFTER
    assert capture.lost == 0
    assert run.estimates is not None
    assert len(run.estimates) >= (AFTER - 128 * 8) // 8
    # A process that died has left no end marker, which is told; nothing else speaks against the record.
    died = [line for one in check(run.path) for line in one.problems if "without an end marker" not in line]
    assert died == []


@pytest.mark.parametrize("kind", IN_PYTHON)
def test_in_python(tmp_path: Path, kind: str) -> None:
    wrong, name = IN_PYTHON[kind], f"{HERE / 'misbehaving.py'}:{kind}"
    scenario = gyro.scenario(tmp_path / "board.toml")
    run = ran(tmp_path, with_plugin(name, wrong), link=f"pty:{scenario}")
    is_stopped_and_named(run, name, wrong.words)


@pytest.mark.parametrize("kind", IN_C)
def test_in_c(tmp_path: Path, kind: str) -> None:
    wrong, name = IN_C[kind], library(tmp_path, kind)
    scenario = gyro.scenario(tmp_path / "board.toml")
    run = ran(tmp_path, with_plugin(name, wrong), link=f"pty:{scenario}")
    is_stopped_and_named(run, name, wrong.words)


UNHURRIED = {
    "Raises": "observe raised RuntimeError",
    "Blocks": "it did not come back within 4 s",
    "Crashes": "it crashed (SIGSEGV)",
    "ExitsAtOnce": "the loop's process ended with code 0",
    "Sleeps": "it took 0.7",
}


@pytest.mark.realtime
@pytest.mark.parametrize("kind", UNHURRIED)
def test_by_the_clock_safe_is_confirmed_and_the_exit_code_is_1(tmp_path: Path, kind: str) -> None:
    name = f"{HERE / 'misbehaving.py'}:{kind}"
    declared = gyro.unhurried_bench(10.0, link={"watchdog_s": gyro.WATCHDOG_S, "timeout_s": 2.0})
    declared = override(declared, {"observer": {"plugin": name}}, "test")
    scenario = gyro.unhurried_scenario(tmp_path / "board.toml")
    with Host(tmp_path / "host", declared, f"pty:{scenario}") as host:
        code, _ = host.ends()
        assert code == 1
        told = "; ".join(host.result["reasons"])
        assert UNHURRIED[kind] in told
        assert f"misbehaving.py:{kind}" in told
        assert host.result["parts"]["safety"]["outcome"] == "good", host.result["parts"]["safety"]
        assert len(host.capture) >= AFTER


@pytest.mark.parametrize("language", ["Python", "C"])
def test_a_constant_that_is_no_number_any_more_is_told(tmp_path: Path, language: str) -> None:
    in_c = language == "C"
    name = library(tmp_path, "NAN_CONSTANT") if in_c else f"{HERE / 'misbehaving.py'}:NanConstant"
    result = ran(tmp_path, bench(name, changes=SHORT | {"limits": {"residual_safe": 1e9}})).result
    assert result is not None
    assert result.complete
    gave = (
        f"gave NaN for kxy, first at sample {AFTER}; its"
        if in_c
        else "gave NaN for phi_x and kxy, first at sample 0; their"
    )
    told = [remark for remark in result.remarks if "NaN" in remark]
    assert len(told) == 1
    assert f"plugin {name.rpartition('/')[2]}: {gave} declared value" in told[0]


@pytest.mark.parametrize("dry_run", [False, True])
@pytest.mark.parametrize(
    ("wrong", "options", "words"),
    [
        ("NAN_STATE", ["-DVERSION_GIVEN=99u"], "is of version 99 of gyro_plugin.h, this bench has 1"),
        ("NAN_STATE", ["-DWITHOUT_INIT"], "has no function gyro_plugin_init"),
        ("-1", [], "it takes no device"),
        ("CRASHES", ["-DAFTER=10"], "it crashed (SIGSEGV)"),
        ("EXITS_AT_ONCE", ["-DAFTER=10"], "the loop's process ended with code 0, with [observer] plugin"),
    ],
)
def test_what_is_wrong_at_once_is_found_before_a_board_is_armed(
    tmp_path: Path, wrong: str, options: list[str], words: str, *, dry_run: bool
) -> None:
    scenario = gyro.scenario(tmp_path / "board.toml")
    with pytest.raises((InputError, WireError)) as refusal:
        ran(tmp_path, bench(library(tmp_path, wrong, *options), changes=SHORT), link=f"pty:{scenario}", dry_run=dry_run)
    assert words in str(refusal.value)
    assert not any((tmp_path / "runs").glob("*"))


def test_one_that_cannot_be_made_is_found_before_a_board_is_armed(tmp_path: Path) -> None:
    name = f"{HERE / 'misbehaving.py'}:RaisesAtOnce"
    with pytest.raises(InputError, match=r"it cannot be made: ValueError: no such device, misbehaving\.py line"):
        ran(tmp_path, bench(name))


def test_a_process_that_ends_with_its_recorder_leaves_no_board_driven() -> None:
    """Both ends come at once: the board is told to be SAFE all the same."""
    said = json.dumps({"armed": True, "board": 7})
    worker = subprocess.Popen([sys.executable, "-c", f"print({said!r})"], stdout=subprocess.PIPE)
    os.waitid(os.P_PID, worker.pid, os.WEXITED | os.WNOWAIT)
    told: list[int] = []

    def confirm(board: int) -> dict[str, object]:
        told.append(board)
        return Safety(armed=True, confirmed=True).told

    with closing(_Followed(worker, lambda _: None, confirm, lambda _: None)) as followed:
        followed.to_the_end()
    worker.communicate()
    assert told == [7]
