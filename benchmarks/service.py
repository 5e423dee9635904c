"""The bench service beside the loop: what a page costs, how soon its key makes the board SAFE, what a kill leaves.

`share`: gain mode at 100 kS/s over a pty, in turns with the streams of a page and without: the service's share of a
core, matrices not in time, samples lost.  `key`: the page in a real browser, force mode at 4 kHz, from the event of the
key to the message with the board's word, by the browser's clock.  `kills`: kill -9 of service or loop at random
moments: is the board SAFE, and are rows missing that the record says nothing of.  SERVICE_PARTS names some of them,
SERVICE_TIMES is how many keys and kills there are, SERVICE_S how long the run of `share` is.
"""

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.row import Row, Say
from hil import client
from hil.bench import Bench, load_bench
from hil.bench.examples import find
from hil.boards.emulation import emulator
from hil.client import Service
from hil.errors import InputError
from hil.records.capture import read_capture
from hil.records.runfolder import RunFolder
from hil.records.timing import Timing
from tests.running.gyro import bench_file, unhurried_bench, unhurried_scenario
from tests.running.processes import alive, command_line, safe_reason

STRETCH_S, SETTLE_S = 4.0, 1.0  # of a stretch the first second is left out
PATIENCE_S = 120.0
SHOWN = (
    {"op": "pattern", "id": 1, "periods": 3},
    {"op": "subscribe", "id": 2, "channels": ["capture.vx_V", "capture.vy_V"], "window_s": 0.02, "points": 800},
    {"op": "subscribe", "id": 3, "channels": ["innovation.nu_x_V", "innovation.nu_y_V"], "window_s": 10, "points": 400},
    {"op": "spectrum", "id": 4, "channel": "innovation.nu_x_V"},
    {"op": "spectrum", "id": 5, "channel": "innovation.nu_y_V"},
)
"""What a page asks for: the pattern, a scope over both axes, the innovation over ten seconds, two spectra."""
_KEY = """
globalThis.safes = [];
let pressed = 0;
const press = ({ key, timeStamp }) => { if (key === "Escape") pressed = timeStamp; };
window.addEventListener("keydown", press, { capture: true });
globalThis.WebSocket = class extends WebSocket {
  constructor(...given) {
    super(...given);
    this.addEventListener("message", ({ data }) => {
      if (typeof data !== "string" || !data.includes('"safe"')) return;
      const said = JSON.parse(data);
      if (said.kind === "safe") safes.push([performance.now() - pressed, said.confirmed]);
    });
  }
};
"""


def rows(say: Say) -> list[Row]:
    """All of it."""
    times, seconds = int(os.environ.get("SERVICE_TIMES", "100")), float(os.environ.get("SERVICE_S", "60"))
    parts: dict[str, Callable[[Path], list[Row]]] = {
        "share": lambda place: share(place, seconds),
        "key": lambda place: keys(place, say, times),
        "kills": lambda place: kills(place, say, times),
    }
    found = []
    for part in os.environ.get("SERVICE_PARTS", " ".join(parts)).split():
        say(part)
        with tempfile.TemporaryDirectory() as place:
            found += parts[part](Path(place))
    return found


def share(place: Path, seconds: float) -> list[Row]:
    """Gain mode at 100 kS/s, by turns beside no page and one."""
    stretches: list[tuple[bool, float, float, float]] = []  # with a page, from and to in bench time, cores
    with running_service(place) as (service, process), service.board("benchmark") as board:
        board.connect("pty:s-modern-5k", "s-modern-5k")
        run = board.start(patient("s-modern-5k"), duration_s=seconds + 15.0)
        _until(lambda: bool(service.state["health"].get("samples")))
        time.sleep(5.0)
        end = time.monotonic() + seconds
        while time.monotonic() < end and service.state["stage"] == "run":
            with_page = len(stretches) % 2 == 1
            with _page_open(service, open_it=with_page):
                time.sleep(SETTLE_S)
                first, cpu, begin = _bench_s(service), cpu_s(process), time.monotonic()
                time.sleep(STRETCH_S - SETTLE_S)
                cores = (cpu_s(process) - cpu) / (time.monotonic() - begin)
                stretches.append((with_page, first, _bench_s(service), cores))
        if service.state["run"] == run.id:
            board.stop()
        run.finished()
    folder = place / "runs" / run.id
    timing, result = Timing.read(folder / "timing.arrow"), RunFolder(folder).result
    applied = timing.columns["applied_tick"]
    late = (applied < 0) | (applied > timing.tick + int(timing.header["block"]) + 1)
    times = timing.tick / float(timing.header["tick_rate_Hz"])
    figures = []
    for with_page, beside in ((False, "no page"), (True, "a page")):
        of = [(first, last, cores) for what, first, last, cores in stretches if what == with_page]
        inside = [late[(times >= first) & (times < last)] for first, last, _ in of]
        figures += [
            Row(f"100 kS/s, {beside}: service, of a core", 100.0 * float(np.mean([cores for *_, cores in of])), "%"),
            Row(f"100 kS/s, {beside}: matrices not in time", 100.0 * float(np.mean(np.concatenate(inside))), "%"),
        ]
    return [*figures, Row("100 kS/s: samples lost", np.nan if result is None else float(result.lost), "1")]


@contextmanager
def _page_open(service: Service, *, open_it: bool) -> Iterator[None]:
    """The streams of a page, read by a thread."""
    if not open_it:
        yield
        return
    ended = threading.Event()
    with service.live() as live:
        for asked in SHOWN:
            live.say(**asked)

        def read() -> None:
            for _ in live.received():
                if ended.is_set():
                    return

        reader = threading.Thread(target=read, daemon=True)
        reader.start()
        yield
        ended.set()
        reader.join(PATIENCE_S)


def keys(place: Path, say: Say, how_many: int) -> list[Row]:
    """Escape, pressed at random moments of a run in a browser."""
    from playwright.sync_api import sync_playwright

    chromium = shutil.which("chromium")
    if chromium is None:
        raise InputError("key: no chromium; sudo apt install chromium, or leave it out of SERVICE_PARTS")
    chance = random.Random(1)
    with running_service(place) as (service, _), sync_playwright() as playwright:
        with service.board("benchmark") as board:
            board.connect("pty:s-slow", "s-slow")
        options = ["--no-sandbox"] if os.geteuid() == 0 else []
        browser = playwright.chromium.launch(executable_path=chromium, args=options)
        page = browser.new_page(viewport={"width": 1440, "height": 900})
        page.add_init_script(_KEY)
        page.goto(f"{service.requests.url}/#token={service.requests.token}")
        for number in range(how_many):
            with service.board("benchmark") as board:
                run = board.start(patient("s-slow"), duration_s=60.0)
                page.wait_for_timeout(chance.uniform(300.0, 1300.0))
                page.keyboard.press("Escape")
                while page.evaluate("safes.length") <= number:  # the page's own policy forbids to wait by a script
                    page.wait_for_timeout(50.0)
                run.finished()
            if number % 10 == 9:
                say(f"{number + 1} of {how_many}, {page.evaluate('safes.at(-1)[0]'):.1f} ms")
        took, confirmed = zip(*page.evaluate("safes"), strict=True)
        browser.close()
    return [
        *(Row(f"from the key to SAFE, p{p} of {how_many}", float(np.percentile(took, p)), "ms") for p in (50, 99)),
        Row("from the key to SAFE, longest", max(took), "ms"),
        Row("from the key to SAFE, not confirmed", float(sum(one is not True for one in confirmed)), "1"),
    ]


def kills(place: Path, say: Say, how_many: int = 100) -> list[Row]:
    """kill -9 of the service or of the loop at random moments of a run."""
    chance = random.Random(1)
    safe_each = orphans = lost_rows = 0
    for number in range(how_many):
        victim = ("service", "loop")[number % 2]
        here = place / str(number)
        with own_board(here) as url:
            went_safe, lost = _killed(here, url, victim, chance.uniform(0.2, 2.0))
        safe_each += went_safe
        lost_rows += lost
        _until(partial(_is_empty, here), fail=False)
        orphans += len(_of(here))
        if number % 10 == 9 or not went_safe or lost:
            say(f"{number + 1} of {how_many}: {victim}, SAFE {bool(went_safe)}, rows lost {lost}")
    return [
        Row(f"kill -9 of service or loop, {how_many}: board in SAFE", float(safe_each), "1"),
        Row(f"kill -9 of service or loop, {how_many}: rows lost", float(lost_rows), "1"),
        Row(f"kill -9 of service or loop, {how_many}: processes left over", float(orphans), "1"),
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
            (loop,) = _of(here, "hil.running.process.worker")
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


@contextmanager
def own_board(place: Path) -> Iterator[str]:
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


def _is_empty(place: Path) -> bool:
    return not _of(place)


def _until(condition: Callable[[], bool], *, fail: bool = True) -> None:
    end = time.monotonic() + PATIENCE_S
    while not condition():
        if time.monotonic() > end:
            if fail:
                raise TimeoutError("waited in vain")
            return
        time.sleep(0.05)


def patient(name: str) -> Bench:
    """An example's bench for a machine that is too busy: the run goes on all the same, and what is compared within it
    stays comparable."""
    return load_bench(find("bench", name)).with_(limits={"rearm": 1_000_000, "residual_safe": 1e9})


def _bench_s(service: Service) -> float:
    for state in service.states():
        if state["now"] is not None:
            return float(state["now"]["t_s"])
        if state["run"] is None:
            break
    return 0.0


def cpu_s(process: int) -> float:
    """Time on a processor of a process so far."""
    words = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")
