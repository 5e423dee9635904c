"""One run of `hil` on a disk that fails, and what came of it."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from hil.bench import examples, load_bench, override
from hil.bench.template import template, values_of
from hil.boards.emulation import emulator
from hil.errors import InputError
from hil.records.check import check
from hil.toml.reading import read_table, toml_value
from hil.wire import client
from hil.wire.endpoint import Endpoint
from hil.wire.links import open_link
from hil.wire.messages import SafeReason, State
from tests.records.failing_disk.disk import FAULTS, HARMLESS, REMOVES, Disk, Fault

WAYS = ("lockstep in process", "paced over a pty")
"""The worker writes the files itself; and a recorder behind rings does."""

_NO_FAULT = Fault(0, 0, lasting=False)
_SECONDS = {"lockstep in process": 1.0, "paced over a pty": 1.0}
_END_S = 600.0
_LEFT_S = 10.0
_LATCHING = ("HOST_REQUEST", "INTERRUPTED", "RESIDUAL")
_SPY = '''"""The emulated board, which leaves behind in which state it ended."""

import os

from device_emulator.inprocess import open_board as open_real


def open_board(scenario, truth=None, seed=None):
    board = open_real(scenario, truth, seed)
    close = board.close

    def told():
        status = board._board
        with open(os.environ["BOARD_STATE"], "w") as file:
            file.write(f"{status.state.name} {status._reason.name} {status.tick}")
        close()

    board.close = told
    return board
'''


class Outcome(NamedTuple):
    """What came of one run. `hit` is the call that failed, "" where the run made fewer; each fault it showed is in
    `wrong`, one line each."""

    way: str
    fault: str
    at: int
    hit: str
    code: int
    line: str
    verdict: str
    board: str
    wrong: tuple[str, ...]


class Campaign:
    """Runs below `place`, on one disk; as a context manager, since the board of a paced run serves all of them."""

    def __init__(self, place: Path, way: str) -> None:
        self._place, self._way = place, way
        self._disk = Disk(place, place / "runs")
        self._url = ""
        self._number = 0
        self.calls: list[str] = []
        self._bench = _bench(place, way)
        self._scenario = _scenario(place)
        if self._lockstep:
            _install_spy(place)

    @property
    def _lockstep(self) -> bool:
        return self._way == "lockstep in process"

    @contextmanager
    def board(self) -> Iterator["Campaign"]:
        """The board of paced runs, for the length of the block."""
        if self._lockstep:
            self._url = f"inproc:{self._scenario}"
            yield self
            return
        with emulator(self._scenario) as board:
            self._url = board.url
            yield self

    def reach(self) -> list[str]:
        """The `calls` of a run that nothing happens to, in their order. Raises InputError when it does not end well."""
        ended = self._run(0, "", _NO_FAULT)
        if ended.wrong:
            raise InputError(f"{self._way}: a run on a sound disk: {ended.wrong[0]}: {ended.line}")
        self.calls = self._disk.log
        return self.calls

    def fail(self, fault: str, at: int) -> Outcome:
        """A run whose call number `at` fails so."""
        return self._run(at, fault, FAULTS[fault])

    def _run(self, at: int, name: str, fault: Fault) -> Outcome:
        self._number += 1
        runs = self._place / "runs"
        _remove(runs)
        state = self._place / "state"
        state.unlink(missing_ok=True)
        self._disk.fail(at, fault)
        family = f"failing-disk-{os.getpid()}-{self._number}"
        spy = f"{self._place / 'spy'}{os.pathsep}" if self._lockstep else ""
        host = subprocess.Popen(
            [sys.executable, "-m", "hil", "run", str(self._bench), "--link", self._url, "--arm", "--out", str(runs)],
            env=os.environ
            | self._disk.environment
            | {
                "BOARD_STATE": str(state),
                "FAMILY": family,
                "PYTHONPATH": f"{spy}{os.environ.get('PYTHONPATH', '')}",
                "PYTHONWARNINGS": "default",
            },
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            cwd=self._place,
            start_new_session=True,
        )
        try:
            _, said = host.communicate(timeout=_END_S)
        except subprocess.TimeoutExpired:
            host.kill()
            _, said = host.communicate()
            said += "\nhangs"
        hit = self._disk.log[0].replace(str(self._place), "") if self._disk.failed else ""
        rings = self._disk.rings
        self._disk.fail(0, _NO_FAULT) if at else None
        result = _result(runs)
        board = self._board_state(state)
        wrong = [
            *_wrong_end(host.returncode, said, result, name if hit else "", at),
            *_wrong_board(board, armed=_has_rows(runs)),
            *_wrong_files(runs, removable=not (fault.lasting and fault.which & REMOVES)),
            *_left_behind(family, rings),
        ]
        lines = [line for line in said.splitlines() if line.startswith("hil: ")]
        reason = next(iter(result.get("reasons", ())), "")
        line = lines[-1] if lines else str(reason)
        return Outcome(
            self._way, name, at, hit, host.returncode, line, str(result.get("verdict", "")), board, tuple(wrong)
        )

    def _board_state(self, state: Path) -> str:
        if self._lockstep:
            return state.read_text(encoding="utf-8") if state.exists() else "never begun"
        endpoint = Endpoint(open_link(self._url))
        try:
            client.connect(endpoint, 10.0)
            # which asks a board in SAFE why it is there, and changes nothing
            status = client.make_safe(endpoint, SafeReason.LINK_LOST)
            # so that the next run finds a board that was stopped for no reason of a host's
            client.arm(endpoint)
            client.make_safe(endpoint, SafeReason.LINK_LOST)
        finally:
            endpoint.close()
        return f"{State(status.state).name} {SafeReason(status.reason).name} {status.tick}"


def _wrong_end(code: int, said: str, result: dict[str, Any], fault: str, at: int) -> Iterator[str]:
    """What a run that met `fault` ("" for none) should not have ended with."""
    if "Traceback" in said:
        last = [line for line in said.splitlines() if line.strip()][-1]
        yield f"a traceback: {last}"
    if "hangs" in said.splitlines():
        yield "does not end"
    sound = not fault or fault in HARMLESS
    if sound and not (code in (0, 1) and result.get("complete") and _safety(result) == "good"):  # else the model's word
        yield f"exit code {code}, safety {_safety(result) or 'not told'}, though nothing was lost"
    if not sound and code not in (0, 1, 2):
        yield f"exit code {code}"
    lines = [line for line in said.splitlines() if line.startswith("hil: ")]
    reasons = [str(reason) for reason in result.get("reasons", ())]
    if len(lines) > 1:
        yield f"{len(lines)} lines"
    if not sound:
        words = os.strerror(FAULTS[fault].error).lower()
        named = any(words in line.lower() for line in [*lines, *reasons])
        if code == 0:
            yield "exit code 0, though a call failed"
        elif not named:
            yield f"{words!r} is not told"


def _safety(result: dict[str, Any]) -> str:
    parts: dict[str, dict[str, str]] = result.get("parts", {})
    return parts.get("safety", {}).get("outcome", "")


def _wrong_board(board: str, *, armed: bool) -> Iterator[str]:
    """A board that is not where a host that ends must leave it."""
    if board == "never begun":
        return
    state, reason, _ = board.split()
    if state not in ("SAFE", "IDLE", "BOOT"):
        yield f"the board is left {state}"
    elif reason == "WATCHDOG":
        yield "the board was left to its watchdog"
    elif armed and (state, reason) not in [("SAFE", name) for name in _LATCHING]:
        yield f"the board was not told to stop: {state}, {reason}"


def _wrong_files(runs: Path, *, removable: bool) -> Iterator[str]:
    """Files that neither `hil check` nor `--repair` can do anything with, and what should not be there."""
    for folder in _folders(runs):
        for path in sorted(folder.iterdir()):
            if path.suffix == ".part" and removable:
                yield f"{path.name} is left behind"
        if not (folder / "capture.arrow").exists():
            if removable:
                yield f"a folder without a record is left behind: {[path.name for path in folder.iterdir()]}"
            continue
        try:
            found = check(folder)
        except InputError as error:
            yield f"cannot be read: {error}"
            continue
        for file in found:
            if problem := next((line for line in file.problems if "damaged" in line), ""):
                yield f"{file.name}: {problem}"


def _left_behind(family: str, rings: set[Path]) -> Iterator[str]:
    """Processes of the run that are still there, and those of its rings; they are ended, removed, and told."""
    until_s = time.monotonic() + _LEFT_S
    while (left := _processes(family)) and time.monotonic() < until_s:
        time.sleep(0.02)
    for process in left:
        command = Path(f"/proc/{process}/cmdline").read_text().replace("\0", " ")
        os.kill(process, signal.SIGKILL)
        yield f"still runs: {command}"
    for ring in sorted(rings):
        if ring.exists():
            ring.unlink()
            yield f"{ring} is left behind"


def _processes(family: str) -> list[int]:
    found = []
    for place in Path("/proc").iterdir():
        if not place.name.isdigit():
            continue
        try:
            if f"FAMILY={family}".encode() in (place / "environ").read_bytes().split(b"\0"):
                found.append(int(place.name))
        except OSError:  # it has ended, or is another's
            continue
    return found


def _folders(runs: Path) -> list[Path]:
    return sorted(path for path in runs.iterdir() if path.is_dir()) if runs.is_dir() else []


def _has_rows(runs: Path) -> bool:
    for folder in _folders(runs):
        try:
            return any(file.rows for file in check(folder))
        except InputError:
            return False
    return False


def _result(runs: Path) -> dict[str, Any]:
    for folder in _folders(runs):
        if (path := folder / "result.json").exists():
            found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
            return found
    return {}


def _remove(runs: Path) -> None:
    for folder in _folders(runs):
        for path in folder.iterdir():
            path.unlink()
        folder.rmdir()
    if runs.is_dir():
        runs.rmdir()


def _install_spy(place: Path) -> None:
    """An emulator that the host finds before the installed one, by its entry point."""
    package = place / "spy"
    about = package / "spy_emulator-0.dist-info"
    about.mkdir(parents=True)
    (package / "spy_emulator.py").write_text(_SPY, encoding="utf-8")
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: spy-emulator\nVersion: 0\n", encoding="utf-8")
    (about / "entry_points.txt").write_text("[hil.emulators]\nspy = spy_emulator:open_board\n", encoding="utf-8")


def _bench(place: Path, way: str) -> Path:
    """S-slow ten times slower, so that a busy machine is not what is seen."""
    declared = override(
        load_bench(examples.find("bench", "s-slow")),
        {
            "loop": {
                "duration_s": _SECONDS[way],
                "settle_s": 0.4 * _SECONDS[way],
                "clock": "lockstep" if way == WAYS[0] else "paced",
                "seed": 7,
            },
            "link": {"watchdog_s": 0.5, "timeout_s": 5.0},
            "limits": {"late_fraction": 1.0, "residual_safe": 1e6},
        },
        "io_faults",
    )
    path = place / "io.bench.toml"
    path.write_text(template(values_of(declared), "For a disk that fails."), encoding="utf-8")
    return path


def _scenario(place: Path) -> Path:
    table = read_table(examples.find("scenario", "s-slow"))
    table["rate"] = {"kind": "constant", "rate_rad_s": 1.0}
    lines = [f"seed = {table.pop('seed')}"]
    for section, keys in table.items():
        lines += [f"[{section}]", *(f"{key} = {toml_value(value)}" for key, value in keys.items())]
    path = place / "io.scenario.toml"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path
