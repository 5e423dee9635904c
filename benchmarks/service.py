"""The bench service beside the loop: what pages cost it, how soon SAFE is there, what dies and what goes on.

Pages come and go within one run: a few seconds with none, with five, with work in their place that knows nothing of the
bench and takes as much of the processors; whatever else the machine does, it does to all three.  A difference of late
answers is a mean over pairs of neighbouring stretches, with its 95 % interval (Student).  What pages cost beyond other
work of their size is the service's; the rest is the machine's.  SERVICE_SAFES, SERVICE_KILLS, SERVICE_CYCLES and
SERVICE_RUN_S set how many and how long, SERVICE_SEED the moments; what was asked for is in the rows.
"""

import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from benchmarks.row import Row, Say
from hil import client
from hil.bench import Bench, load_bench
from hil.bench.examples import find
from hil.boards.emulation import emulator
from hil.client import Service
from hil.errors import InputError
from hil.records.blocks import GrowingFile
from hil.records.capture import read_capture
from hil.records.runfolder import RunFolder
from hil.records.timing import read_timing
from hil.wire.messages import SenseFlags
from tests.running.gyro import bench_file, unhurried_bench, unhurried_scenario
from tests.running.processes import alive, command_line, safe_reason

PAGES = 5
STRETCH_S = 4.0
SETTLE_S = 1.0  # of a stretch, left out
SAFES = int(os.environ.get("SERVICE_SAFES", "100"))
KILLS = int(os.environ.get("SERVICE_KILLS", "100"))
SEED = int(os.environ.get("SERVICE_SEED", "1"))
CYCLES = int(os.environ.get("SERVICE_CYCLES", "1000"))
RUN_S = float(os.environ.get("SERVICE_RUN_S", "60"))
PATIENCE_S = 120.0


def rows(say: Say) -> list[Row]:
    """All of it."""
    found = []
    for part in os.environ.get("SERVICE_PARTS", "force gain safe kills cycles").split():
        say(part)
        with tempfile.TemporaryDirectory() as place:
            made = _PARTS[part](Path(place), say)
        for row in made:  # at once: the parts to come take hours
            say(f"{row.name}: {row.value:.4g} {row.unit}")
        found += made
    return found


# -- pages beside the loop -------------------------------------------------------------------------------------------


def force(place: Path, say: Say) -> list[Row]:
    """Force mode at 4 kHz, with what the rings and the files tell of a sample, and when."""
    with running_service(place) as (service, process):
        run, stretches, seen = _alternating(service, process, place, "s-slow", say, watch_file=True)
    capture = read_capture(run / "capture.arrow")
    late = (np.asarray(capture.flags) & SenseFlags.HELD) > 0
    found = _differences("force mode, 4 kHz: answers not in time", np.asarray(capture.t_s), late, stretches)
    timing = read_timing(run / "timing.arrow")
    for name, pairs in seen.items():
        at = np.searchsorted(timing.tick, [tick for _, tick in pairs])
        kept = at < len(timing)
        ages = np.array([when for when, _ in pairs])[kept] - timing.columns["t_receive_ns"][at[kept]]
        found += [
            Row(f"newest sample seen in the {name}, age p{p}", float(np.percentile(ages, p)) * 1e-6, "ms")
            for p in (50, 99)
            if len(ages)
        ]
    return found + _costs("force mode, 4 kHz", stretches)


def gain(place: Path, say: Say) -> list[Row]:
    """Gain mode at 100 kS/s."""
    with running_service(place) as (service, process):
        run, stretches, _ = _alternating(service, process, place, "s-modern-5k", say)
    timing = read_timing(run / "timing.arrow")
    block = int(timing.header["block"])
    applied = timing.columns["applied_tick"]
    late = (applied < 0) | (applied > timing.tick + block + 1)
    times = timing.tick / float(timing.header["tick_rate_Hz"])
    lost = RunFolder(run).result
    found = _differences("gain mode, 100 kS/s: matrices not in time", times, late, stretches)
    if lost is not None:
        found.append(Row("gain mode, 100 kS/s: samples lost", float(lost.lost), "1"))
    return found + _costs("gain mode, 100 kS/s", stretches)


NONE, OPEN, OTHER = "no page", f"{PAGES} pages", "other work"


class Stretch:
    """A few seconds of a run beside nothing, pages, or other work."""

    def __init__(self, beside: str) -> None:
        self.beside = beside
        self.from_s = self.to_s = 0.0  # bench time
        self.cpu = 0.0  # of the service, cores
        self.cpu_pages = 0.0  # of those who read, cores
        self.frames: list[float] = []  # a second, of the scope, per page


def _alternating(
    service: Service, process: int, place: Path, name: str, say: Say, *, watch_file: bool = False
) -> tuple[Path, list[Stretch], dict[str, list[tuple[int, int]]]]:
    stretches: list[Stretch] = []
    seen: dict[str, list[tuple[int, int]]] = {"rings": [], "files": []} if watch_file else {}
    with service.board("benchmark") as board:
        board.connect(f"pty:{name}", name)
        run = board.start(patient(name), duration_s=RUN_S + 15.0)
        folder = place / "runs" / run.id
        while (service.state["health"].get("samples") or 0) == 0:
            time.sleep(0.1)
        time.sleep(5.0)
        end = time.monotonic() + RUN_S
        while time.monotonic() < end and service.state["stage"] == "run":
            stretch = Stretch((NONE, OPEN, OTHER)[len(stretches) % 3])
            with _beside(service, stretch, stretches):
                time.sleep(SETTLE_S)
                stretch.from_s, cpu, begin = _bench_s(service), cpu_s(process), time.monotonic()
                if seen:
                    _watch(service, folder, seen, STRETCH_S - SETTLE_S)
                else:
                    time.sleep(STRETCH_S - SETTLE_S)
                stretch.to_s = _bench_s(service)
                stretch.cpu = (cpu_s(process) - cpu) / (time.monotonic() - begin)
            stretches.append(stretch)
        say(f"{len(stretches)} stretches")
        if service.state["run"] == run.id:
            board.stop()
        run.finished()
    return folder, stretches, seen


def patient(name: str) -> Bench:
    """An example's bench for a machine that is too busy: the run goes on all the same, and what is compared within it
    stays comparable."""
    return load_bench(find("bench", name)).with_(limits={"rearm": 1_000_000, "residual_safe": 1e9})


def _watch(service: Service, folder: Path, seen: dict[str, list[tuple[int, int]]], seconds: float) -> None:
    """Note when which sample is the newest one that is told by the live connection, and by the files."""
    end = time.monotonic() + seconds
    growing = GrowingFile(folder / "capture.arrow", "capture")
    newest = -1
    with service.live() as live:
        live.say(op="subscribe", id=1, channels=["capture.vx_V"], window_s=0.2, points=800)
        for said in live.received():
            now = time.monotonic_ns()
            if isinstance(said, client.Frame):
                seen["rings"].append((now, said.first + said.low.shape[1] - 1))
                ticks = growing.news()["tick"]
                newest = int(ticks[-1]) if len(ticks) else newest
                if newest >= 0:
                    seen["files"].append((time.monotonic_ns(), newest))
            if time.monotonic() > end:
                break
    growing.close()


def _differences(name: str, times: Any, late: Any, stretches: list[Stretch]) -> list[Row]:
    """Shares of late answers, percent, beside nothing, pages and other work, and their differences."""
    shares: dict[str, list[float]] = {NONE: [], OPEN: [], OTHER: []}
    for stretch in stretches[: len(stretches) // 3 * 3]:
        inside = (times >= stretch.from_s) & (times < stretch.to_s)
        shares[stretch.beside].append(100.0 * float(np.mean(late[inside])) if inside.any() else np.nan)
    found = [Row(f"{name}, {beside}", float(np.nanmean(of)), "%") for beside, of in shares.items()]
    for more, less in ((OPEN, NONE), (OTHER, NONE), (OPEN, OTHER)):
        differences = np.array(shares[more]) - np.array(shares[less])
        differences = differences[np.isfinite(differences)]
        if (pairs := len(differences)) > 1:
            half = stats.t.ppf(0.975, pairs - 1) * differences.std(ddof=1) / np.sqrt(pairs)
            found += [
                Row(f"{name}, {more} less {less} over {pairs} pairs", float(differences.mean()), "%"),
                Row(f"{name}, {more} less {less}, half its 95 % interval", float(half), "%"),
            ]
    return found


def _costs(name: str, stretches: list[Stretch]) -> list[Row]:
    found = []
    for beside in (NONE, OPEN):
        cpu = [100.0 * stretch.cpu for stretch in stretches if stretch.beside == beside]
        if cpu:
            found.append(Row(f"{name}: service with {beside}, of a core", float(np.mean(cpu)), "%"))
    readers = [100.0 * stretch.cpu_pages for stretch in stretches if stretch.beside == OPEN]
    if readers:
        found.append(Row(f"{name}: the {PAGES} pages themselves, of a core", float(np.mean(readers)), "%"))
    frames = [rate for stretch in stretches for rate in stretch.frames]
    if frames:
        found.append(Row(f"{name}: frames a second, slowest page of a stretch", min(frames), "Hz"))
        found.append(Row(f"{name}: frames a second, median", float(np.median(frames)), "Hz"))
    return found


@contextmanager
def _beside(service: Service, stretch: Stretch, before: list[Stretch]) -> Iterator[None]:
    """Whatever the stretch is to be measured beside."""
    if stretch.beside == NONE:
        yield
        return
    if stretch.beside == OPEN:
        given = ["benchmarks.service_pages", service.requests.url + "/", service.requests.token, str(PAGES)]
    else:
        without, pages = before[-2:]
        given = ["benchmarks.other_work", str(pages.cpu - without.cpu + pages.cpu_pages)]
    with subprocess.Popen([sys.executable, "-m", *given], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        yield
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.close()
        if stretch.beside == OPEN:
            said = json.loads(process.stdout.readline())
            stretch.frames, stretch.cpu_pages = said["frames"], said["cores"]


def _bench_s(service: Service) -> float:
    for state in service.states():
        if state["now"] is not None:
            return float(state["now"]["t_s"])
        if state["run"] is None:
            break
    return 0.0


def cpu_s(process: int) -> float:
    words = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


# -- SAFE, kills, cycles ---------------------------------------------------------------------------------------------


def safe(place: Path, say: Say) -> list[Row]:
    """From a client's request over the live connection to the board's word that it is SAFE, over a pty, 4 kHz."""
    took = []
    unconfirmed = 0
    with running_service(place) as (service, _), service.board("benchmark") as board:
        board.connect("pty:s-slow", "s-slow")
        for number in range(SAFES):
            run = board.start(patient("s-slow"), duration_s=60.0)
            with service.live() as live:
                time.sleep(random.uniform(0.3, 1.3))
                begin = time.perf_counter()
                live.say(op="safe")
                said = next(m for m in live.received() if isinstance(m, dict) and m["kind"] == "safe")
                took.append(1e3 * (time.perf_counter() - begin))
            unconfirmed += said["confirmed"] is not True
            _until(lambda run=run: service.state["run"] != run.id)
            if number % 10 == 9:
                say(f"{number + 1} of {SAFES}, {took[-1]:.1f} ms")
    return [
        *(Row(f"SAFE over a pty, p{p} of {SAFES}", float(np.percentile(took, p)), "ms") for p in (50, 99)),
        Row("SAFE over a pty, longest", max(took), "ms"),
        Row("SAFE over a pty, not confirmed", float(unconfirmed), "1"),
    ]


def kills(place: Path, say: Say) -> list[Row]:
    """kill -9 of the service or of the loop at random moments of a run."""
    chance = random.Random(SEED)
    safe_each = orphans = lost_rows = 0
    for number in range(KILLS):
        victim = ("service", "loop")[number % 2]
        here = place / str(number)
        with _own_board(here) as url:
            went_safe, lost = _killed(here, url, victim, chance.uniform(0.2, 2.0))
        safe_each += went_safe
        lost_rows += lost
        _until(lambda here=here: not _of(here), fail=False)
        orphans += len(_of(here))
        if number % 10 == 9 or not went_safe or lost:
            say(f"{number + 1} of {KILLS}: {victim}, SAFE {bool(went_safe)}, rows lost {lost}")
    return [
        Row(f"kill -9 of service or loop, {KILLS}: board in SAFE", float(safe_each), "1"),
        Row(f"kill -9 of service or loop, {KILLS}: rows lost", float(lost_rows), "1"),
        Row(f"kill -9 of service or loop, {KILLS}: processes left over", float(orphans), "1"),
    ]


def _killed(here: Path, url: str, victim: str, after_s: float) -> tuple[bool, int]:
    """Whether the board was SAFE in the end, and how many rows are missing in the record that it says nothing of."""
    with running_service(here) as (service, process), service.board("kills") as board:
        board.connect(url, "unhurried")
        run = board.start(arm=True).id
        time.sleep(after_s)
        if victim == "service":
            os.kill(process, signal.SIGKILL)
            time.sleep(0.5)
        else:
            (loop,) = _of(here, "hil.running.worker")
            os.kill(loop, signal.SIGKILL)
            _until(lambda: service.state["run"] is None)
    if victim == "service":  # the loop went on: another service finds it, and ends it
        with running_service(here) as (service, _):
            going_on = service.state["run"] == run
            service.safe()
            _until(lambda: service.state["run"] is None)
            if not going_on:
                return False, 0
    record = here / "runs" / run / "capture.arrow"
    if not record.exists():  # of a loop that died before its first sample nothing is kept
        return safe_reason(url) is not None, 0
    capture = read_capture(record)
    result = RunFolder(here / "runs" / run).result
    first, last = capture.ends
    told = result.lost if result is not None else 0
    return safe_reason(url) is not None, last - first + 1 - len(capture) - told


def cycles(place: Path, say: Say) -> list[Row]:
    """Start and stop, over and over, with one service."""
    failed = 0
    begin = time.monotonic()
    with _own_board(place) as url:
        with running_service(place) as (service, _), service.board("cycles") as board:
            board.connect(url, "unhurried")
            for number in range(CYCLES):
                run = board.start(arm=True).id
                stopped = board.stop()
                _until(lambda run=run: service.state["run"] != run)
                failed += stopped["confirmed"] is not True
                if number % 10 == 9:
                    say(f"{number + 1} of {CYCLES}, {failed} not confirmed")
        _until(lambda: not _of(place), fail=False)
    return [
        Row(f"start and stop, {CYCLES} times: not confirmed", float(failed), "1"),
        Row(f"start and stop, {CYCLES} times: processes left over", float(len(_of(place))), "1"),
        Row("start and stop: one cycle, figures and report included", (time.monotonic() - begin) / CYCLES, "s"),
    ]


@contextmanager
def _own_board(place: Path) -> Iterator[str]:
    """A board that outlives every service, 400 samples a second, and its bench file."""
    place.mkdir(parents=True, exist_ok=True)
    bench_file(place / "unhurried.bench.toml", unhurried_bench(600.0, loop={"settle_s": 0.5}))
    with emulator(unhurried_scenario(place / "unhurried.scenario.toml")) as board:
        yield board.url


@contextmanager
def running_service(place: Path) -> Iterator[tuple[Service, int]]:
    """A service of its own, its process number, and a client of it."""
    place.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-m", "hil", "serve", "--port", "0", "--json", "--folder", str(place / "runs")]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, start_new_session=True)
    try:
        assert process.stdout is not None
        said = json.loads(process.stdout.readline())
        with client.connect(said["links"]["administer"]) as service:
            yield service, process.pid
    except InputError:
        if process.poll() is None:
            raise
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
        process.wait(PATIENCE_S)
        assert process.stdout is not None
        process.stdout.close()


def _of(place: Path, module: str = "") -> list[int]:
    """Processes that belong to a folder, by their command lines or their parents'; of a module, if given."""
    family: set[int] = set()
    parents: dict[int, int] = {}
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit() or not alive(int(entry.name)):
            continue
        try:
            words = command_line(int(entry.name))
            parents[int(entry.name)] = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
        except (OSError, ValueError):
            continue
        if any(str(place / "runs") in word for word in words):
            family.add(int(entry.name))
    for _ in range(4):
        family |= {child for child, parent in parents.items() if parent in family}
    return [one for one in family if alive(one) and (not module or module in command_line(one))]


def _until(condition: Callable[[], bool], *, fail: bool = True) -> None:
    end = time.monotonic() + PATIENCE_S
    while not condition():
        if time.monotonic() > end:
            if fail:
                raise TimeoutError("waited in vain")
            return
        time.sleep(0.05)


_PARTS: dict[str, Callable[[Path, Say], list[Row]]] = {
    "force": force, "gain": gain, "safe": safe, "kills": kills, "cycles": cycles,
}  # fmt: skip
