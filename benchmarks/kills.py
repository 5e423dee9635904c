"""kill -9 at random moments of host, loop, recorder and emulated board, in force and gain mode.

Each run is what a user starts: `hil run` as processes, over a pty.  When the drive became zero is read from the
emulator's truth: force is what is left of the mass' motion after the free oscillation.  The host, the loop's process
and the recorder are killed under a board that lives on; when the board itself is killed nothing is left that drives.

What has to hold: the drive is gone within the board's watchdog, or within a second where the recorder was killed; the
capture is readable up to there; no process is left; whoever can still be told is.

`KILLS_FROM=N` goes on after the first N, with the victims and moments that the whole campaign has.
"""

import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import expm

from benchmarks.row import Row
from hil.bench import examples, load_bench, override
from hil.bench.template import template, values_of
from hil.boards.emulation import Emulator, emulator
from hil.errors import InputError
from hil.records.capture import read_capture
from hil.records.timing import read_timing
from hil.records.truth import Truth, read_truth

Say = Callable[[str], None]

RUNS = 100
SEED = 9
VICTIMS = ("host", "loop", "recorder", "board")
MODES = ("force", "gain")
LATEST_S = 1.5  # after the first samples were recorded
WATCHDOG_S = {"force": 0.2, "gain": 0.2}
RECORDER_S = 1.0
END_S = 60.0
RATE_RAD_S = 1.0
_NOISE = 20.0  # times the median of what the truth shows of force in a tick, above which it is one


class Outcome(NamedTuple):
    """What came of one kill; `released_s` from the kill to the last driven tick, NaN where nobody knows."""

    mode: str
    victim: str
    released_s: float
    in_time: bool
    readable: bool
    orphans: int
    told: bool
    line: str


def rows(say: Say, runs: int = RUNS, seed: int = SEED) -> list[Row]:
    """The campaign as a table, and its counts."""
    outcomes = campaign(say, runs, seed, int(os.environ.get("KILLS_FROM", "0")))
    table: list[Row] = [Row("kills", len(outcomes), "1")]
    for mode in MODES:
        for victim in VICTIMS:
            some = [one for one in outcomes if (one.mode, one.victim) == (mode, victim)]
            released = [one.released_s for one in some if not np.isnan(one.released_s)]
            table.append(Row(f"{mode}, {victim}: kills", len(some), "1"))
            if released:
                table.append(Row(f"{mode}, {victim}: longest drive after it", max(released), "s"))
    for name, held in (
        ("drive gone in time", [one.in_time for one in outcomes]),
        ("capture readable", [one.readable for one in outcomes]),
        ("no process left", [one.orphans == 0 for one in outcomes]),
        ("told", [one.told for one in outcomes]),
    ):
        table.append(Row(f"all: {name}", sum(held), "1"))
    return table


def campaign(say: Say, runs: int, seed: int, first: int) -> list[Outcome]:
    """So many kills, victims and modes in turn, moments by chance; those before `first` were made elsewhere."""
    chance = random.Random(seed)
    outcomes = []
    for number in range(runs):
        victim, mode = VICTIMS[number % len(VICTIMS)], MODES[number // len(VICTIMS) % len(MODES)]
        after_s = chance.uniform(0.0, LATEST_S)
        if number < first:
            continue
        with tempfile.TemporaryDirectory(prefix="kills-") as place:
            outcome = _one(Path(place), mode, victim, after_s)
        outcomes.append(outcome)
        bad = not (outcome.in_time and outcome.readable and outcome.told and outcome.orphans == 0)
        say(f"{number + 1}: {mode}, {victim}: {outcome.released_s:.3f} s{' BAD ' if bad else ' '}{outcome.line}")
    return outcomes


def _one(place: Path, mode: str, victim: str, after_s: float) -> Outcome:
    bench, truth = _bench(place, mode), place / "truth.arrow"
    try:
        with emulator(_scenario(place), truth=truth) as board:
            return _kill(place, bench, mode, victim, after_s, board, truth)
    except InputError:  # of a board that was killed: the outcome is in the file below
        if not (place / "outcome.json").exists():
            raise
        return Outcome(**json.loads((place / "outcome.json").read_text(encoding="utf-8")))


def _kill(place: Path, bench: Path, mode: str, victim: str, after_s: float, board: Emulator, truth: Path) -> Outcome:
    runs = place / "runs"
    host = subprocess.Popen(
        [sys.executable, "-m", "hil", "run", str(bench), "--link", board.url, "--arm", "--out", str(runs)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    capture = _await_samples(runs, host)
    loop = next(child for child in _children(host.pid) if "hil.running.worker" in _command(child))
    (recorder,) = _children(loop)
    family = {"host": host.pid, "loop": loop, "recorder": recorder, "board": board.process.pid}
    time.sleep(after_s)
    os.kill(family[victim], signal.SIGKILL)
    killed_ns = time.monotonic_ns()
    _, said = host.communicate(timeout=END_S)
    ours = [number for name, number in family.items() if name != "board"]
    until_s = time.monotonic() + END_S
    while any(map(_alive, ours)) and time.monotonic() < until_s:
        time.sleep(0.01)
    orphans = sum(map(_alive, ours))
    result = _result(runs)
    rows_read, told = _readable(capture), _told(victim, host.returncode, result, said)
    released_s = float("nan")
    if victim != "board":
        board.stop()
        true = read_truth(truth)
        tick = _tick_at(capture.with_name("timing.arrow"), killed_ns, float(true.header["sample_rate_Hz"]))
        released_s = _released_s(true, tick)
    limit_s = RECORDER_S if victim == "recorder" else WATCHDOG_S[mode]
    in_time = victim == "board" or released_s <= limit_s
    reasons = result.get("reasons", ())
    line = reasons[0] if reasons else " ".join(said.split())[-120:]
    outcome = Outcome(mode, victim, released_s, in_time, rows_read, orphans, told, line)
    (place / "outcome.json").write_text(json.dumps(outcome._asdict()), encoding="utf-8")
    return outcome


def _bench(place: Path, mode: str) -> Path:
    """S-slow, long enough for anything to happen to it."""
    loop: dict[str, Any] = {"duration_s": 600.0, "clock": "paced"}
    if mode == "gain":
        loop |= {"mode": "gain", "block": 40, "estimate_every": 40}
    changes = {"loop": loop, "link": {"watchdog_s": WATCHDOG_S[mode], "timeout_s": 1.0}}
    declared = override(load_bench(examples.find("bench", "s-slow")), changes, "kills")
    path = place / "kills.bench.toml"
    path.write_text(template(values_of(declared), "For kills."), encoding="utf-8")
    return path


def _scenario(place: Path) -> Path:
    """S-slow, turning evenly."""
    text = examples.find("scenario", "s-slow").read_text(encoding="utf-8")
    path = place / "kills.scenario.toml"
    even = f'[rate]\nkind = "constant"\nrate_rad_s = {RATE_RAD_S}\n'
    path.write_text(text[: text.index("[rate]")] + even, encoding="utf-8")
    return path


def _await_samples(runs: Path, host: "subprocess.Popen[str]") -> Path:
    """Path of the capture, once it holds samples and the loop is closed."""
    while host.poll() is None:  # a busy machine takes minutes to begin
        for capture in runs.glob("*/capture.arrow"):
            try:
                if len(read_capture(capture)) > 2000 and len(read_timing(capture.with_name("timing.arrow")).tick):
                    return capture
            except InputError:  # its header is being written
                pass
        time.sleep(0.05)
    raise InputError(f"{runs}: nothing was recorded: {host.communicate()[1]}")


def _readable(capture: Path) -> bool:
    try:
        return len(read_capture(capture)) > 0
    except InputError:
        return False


def _result(runs: Path) -> dict[str, Any]:
    for path in runs.glob("*/result.json"):
        found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        return found
    return {}


def _told(victim: str, code: int, result: dict[str, Any], said: str) -> bool:
    """Whether whoever is left says what happened, without a traceback; a host that was killed cannot."""
    if "Traceback" in said:
        return False
    if victim == "host":
        return code == -signal.SIGKILL
    reasons = " ".join(result.get("reasons", ()))
    words = {"loop": "killed by SIGKILL", "recorder": "recorder was killed", "board": "hung up"}[victim]
    return code == 1 and words in reasons and result["verdict"] in ("interrupted", "unsafe")


def _released_s(truth: Truth, killed_tick: float) -> float:
    """From the kill to the last driven tick, by the board's own ticks; NaN where none was driven."""
    kxx, kyy, kxy = truth.header["stiffness_per_s2"]
    dxx, dyy, dxy = truth.header["damping_per_s"]
    rate_Hz = float(truth.header["sample_rate_Hz"])
    square, double = RATE_RAD_S**2, 2.0 * RATE_RAD_S
    free = np.array(
        [
            [0, 1, 0, 0],
            [square - kxx, -dxx, -kxy, double - dxy],
            [0, 0, 0, 1],
            [-kxy, -double - dxy, square - kyy, -dyy],
        ]
    )
    state = np.column_stack([truth[name] for name in ("x_m", "vx_mps", "y_m", "vy_mps")])
    kick = state[1:] - state[:-1] @ expm(free / rate_Hz).T
    force = np.hypot(kick[:, 1], kick[:, 3])
    floor = np.median(force[-400:])  # in SAFE only noise acts on the mass
    driven = truth.tick[:-1][force > _NOISE * floor]
    return float(driven[-1] - killed_tick) / rate_Hz if len(driven) else float("nan")


def _tick_at(timing: Path, killed_ns: int, rate_Hz: float) -> float:
    """The board's tick at a time of this machine's clock, on which the loop noted when it had each sample: the board is
    on the same machine, and its ticks follow its clock."""
    record = read_timing(timing)
    behind_ns = record.columns["t_receive_ns"] - record.tick * (1e9 / rate_Hz)
    return float(killed_ns - behind_ns.min()) * 1e-9 * rate_Hz


def _children(parent: int) -> list[int]:
    return [int(word) for word in Path(f"/proc/{parent}/task/{parent}/children").read_text().split()]


def _command(process: int) -> str:
    return Path(f"/proc/{process}/cmdline").read_text().replace("\0", " ")


def _alive(process: int) -> bool:
    try:
        return ") Z " not in Path(f"/proc/{process}/stat").read_text()
    except FileNotFoundError:
        return False
