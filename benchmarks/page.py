"""The page in a real browser: the key that makes the board SAFE, at 4 kHz over a pty; how soon it tells that the board
or the service is lost; then, beside a run at 100 kS/s, pictures a second and what the service and the browser need.

PAGE_SAFES sets how often the key is pressed, PAGE_LOSSES how often each of both is lost, PAGE_S how long the run is (by
default a quarter of an hour); 0 leaves a part out.  The key's time is the browser's own, from the event of the key to
the message with the board's word.  A picture counts where the scope was drawn anew between two animation frames; it is
drawn for new samples alone.  The heap is what is left of it after a forced collection; its slope has the 95 % interval
of a straight line whose errors hang together (Newey and West, over a tenth of the points).
"""

import json
import os
import random
import re
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from playwright.sync_api import Page, sync_playwright

from benchmarks.row import Row, Say
from benchmarks.service import cpu_s, patient, running_service
from hil.bench.examples import find
from hil.boards.emulation import emulator
from hil.client import Service

SECONDS = float(os.environ.get("PAGE_S", "900"))
SAFES = int(os.environ.get("PAGE_SAFES", "100"))
LOSSES = int(os.environ.get("PAGE_LOSSES", "20"))
WARM_S = 30.0
EVERY_S = 10.0
_COUNTED = """
globalThis.pictures = 0;
let drawn = false;
const clear = CanvasRenderingContext2D.prototype.clearRect;
CanvasRenderingContext2D.prototype.clearRect = function (...box) {
  drawn ||= Boolean(this.canvas.closest("#scope-chart"));
  return clear.apply(this, box);
};
const count = () => {
  globalThis.pictures += drawn ? 1 : 0;
  drawn = false;
  requestAnimationFrame(count);
};
requestAnimationFrame(count);
"""
_KEY = """
globalThis.safes = [];
let pressed = 0, asked = 0;
const press = ({ key, timeStamp }) => { if (key === "Escape") pressed = timeStamp; };
window.addEventListener("keydown", press, { capture: true });
globalThis.WebSocket = class extends WebSocket {
  constructor(...given) {
    super(...given);
    this.addEventListener("message", ({ data }) => {
      if (typeof data !== "string" || !data.includes('"safe"')) return;
      const said = JSON.parse(data);
      if (said.kind === "safe") safes.push([performance.now() - pressed, said.confirmed, asked - pressed, said.ms]);
    });
  }
  send(data) {
    super.send(data);
    if (typeof data === "string" && data.includes('"safe"')) asked = performance.now();
  }
};
"""
_WORD = """
globalThis.words = [];
addEventListener("DOMContentLoaded", () => {
  const state = document.getElementById("state-word");
  const note = () => words.push([state.textContent, Date.now()]);
  new MutationObserver(note).observe(state, { childList: true, characterData: true, subtree: true });
});
"""


def rows(say: Say) -> list[Row]:
    """One page; a run for each press of the key, and a long one."""
    found = []
    if SAFES:
        with _page("s-slow", _KEY) as (page, service, _):
            found += _keys(page, service, say)
    if LOSSES:
        found += _losses(say)
    if SECONDS:
        with _page("s-modern-5k", _COUNTED) as (page, service, process):
            found += _pictures(page, service, process, say)
    return found


@contextmanager
def _page(example: str, script: str, link: str = "") -> Iterator[tuple[Page, Service, int]]:
    """A browser's page that a script watches, with the emulated board of an example; the service and its process."""
    chromium = shutil.which("chromium")
    if chromium is None:
        sys.exit("no chromium: sudo apt install chromium")
    with (
        tempfile.TemporaryDirectory() as place,
        running_service(Path(place)) as (service, process),
        sync_playwright() as playwright,
    ):
        with service.board("benchmark") as board:
            board.connect(link or f"pty:{example}", example)
        options = ["--no-sandbox"] if os.geteuid() == 0 else []
        browser = playwright.chromium.launch(executable_path=chromium, args=options)
        page = browser.new_page(viewport={"width": 1440, "height": 900})
        page.add_init_script(script)
        page.goto(f"{service.requests.url}/#token={service.requests.token}")
        yield page, service, process
        browser.close()


def _keys(page: Page, service: Service, say: Say) -> list[Row]:
    chance = random.Random(1)
    for number in range(SAFES):
        with service.board("benchmark") as board:
            run = board.start(patient("s-slow"), duration_s=60.0)
            page.wait_for_timeout(chance.uniform(300.0, 1300.0))
            page.keyboard.press("Escape")
            while page.evaluate("safes.length") <= number:  # the page's own policy forbids to wait by a script
                page.wait_for_timeout(50.0)
            run.finished()
        if number % 10 == 9:
            say(f"{number + 1} of {SAFES}, {page.evaluate('safes.at(-1)[0]'):.1f} ms")
    took, confirmed, asked, service_ms = zip(*page.evaluate("safes"), strict=True)
    return [
        *(Row(f"from the key to SAFE, p{p} of {SAFES}", float(np.percentile(took, p)), "ms") for p in (50, 99)),
        Row("from the key to SAFE, longest", max(took), "ms"),
        Row("… of it until the page has asked, p99", float(np.percentile(asked, 99)), "ms"),
        Row("… of it in service, loop and board, p99", float(np.percentile(service_ms, 99)), "ms"),
        Row("from the key to SAFE, not confirmed", float(sum(one is not True for one in confirmed)), "1"),
    ]


def _losses(say: Say) -> list[Row]:
    """A process that is suspended answers nothing, and leaves its line and its port open: no system tells of it."""
    found = []
    with emulator(find("scenario", "s-slow")) as board, _page("s-slow", _WORD, board.url) as (page, _, service):
        for lost, process in ("Board lost", board.process.pid), ("Service lost", service):
            took_ms = [_told_after(page, lost, process) for _ in range(LOSSES)]
            say(f"{lost}: {max(took_ms):.0f} ms at most")
            found += [
                Row(f"{lost}, told, median of {LOSSES}", float(np.median(took_ms)), "ms"),
                Row(f"{lost}, told, latest", max(took_ms), "ms"),
            ]
    return found


def _told_after(page: Page, word: str, process: int) -> float:
    """Milliseconds from the end of its answers to the word for it on the page, by the page's own clock."""
    _wait_for(page, "SAFE")
    page.wait_for_timeout(1000.0)
    begin, seen = 1000.0 * time.time(), page.evaluate("words.length")
    os.kill(process, signal.SIGSTOP)
    try:
        _wait_for(page, word)
    finally:
        os.kill(process, signal.SIGCONT)
    return float(next(when - begin for told, when in page.evaluate("words")[seen:] if told == word))


def _wait_for(page: Page, word: str) -> None:
    while page.evaluate("document.getElementById('state-word').textContent") != word:
        page.wait_for_timeout(50.0)


def _pictures(page: Page, service: Service, process: int, say: Say) -> list[Row]:
    with service.board("benchmark") as board:
        board.start(patient("s-modern-5k"), duration_s=SECONDS + WARM_S + 60.0)
        page.wait_for_selector("#scope-chart canvas")
        session = page.context.new_cdp_session(page)
        session.send("Performance.enable")
        page.wait_for_timeout(1000.0 * WARM_S)
        measured = _measured(page, session, process, say)
        state = service.state
        board.stop()
    return _told(np.array(measured), state)


def _measured(page: Page, session: Any, process: int, say: Say) -> list[tuple[float, float, float, float]]:
    """Seconds, pictures a second, cores of the service and megabytes of heap, at the end of each stretch."""
    found = []
    begin = time.monotonic()
    while time.monotonic() < begin + SECONDS:
        before, cpu, began = page.evaluate("pictures"), cpu_s(process), time.monotonic()
        page.wait_for_timeout(1000.0 * EVERY_S)
        after, took = page.evaluate("pictures"), time.monotonic() - began
        used = cpu_s(process) - cpu
        for _ in range(2):  # what is let go by finalizers goes with the second
            session.send("HeapProfiler.collectGarbage")
        told = {one["name"]: one["value"] for one in session.send("Performance.getMetrics")["metrics"]}
        found.append((time.monotonic() - begin, (after - before) / took, used / took, told["JSHeapUsedSize"] * 1e-6))
        load = re.match(r"\S+", Path("/proc/loadavg").read_text())
        shown = dict(zip(("s", "Hz", "cores", "MB"), (round(value, 3) for value in found[-1]), strict=True))
        say(f"{json.dumps(shown)}, load {load.group() if load else ''}")
    return found


def _told(measured: npt.NDArray[np.float64], state: dict[str, Any]) -> list[Row]:
    t, pictures, cores, heap = measured.T
    slope, half = line(t, heap)
    hour = 3600.0
    return [
        Row("pictures a second, median", float(np.median(pictures)), "Hz"),
        Row(f"pictures a second, least of {len(t)} stretches of {EVERY_S:g} s", float(pictures.min()), "Hz"),
        Row("service, of a core, mean", 100.0 * float(cores.mean()), "%"),
        Row("service, of a core, most of a stretch", 100.0 * float(cores.max()), "%"),
        Row(f"heap after {t[0]:.0f} s", float(heap[0]), "MB"),
        Row(f"heap after {t[-1]:.0f} s", float(heap[-1]), "MB"),
        Row("heap, slope", slope * hour, "MB/h"),
        Row("heap, half the 95 % interval of its slope", half * hour, "MB/h"),
        Row("samples missing", float(state["health"].get("lost", np.nan)), "1"),
    ]


def line(t: npt.NDArray[np.float64], y: npt.NDArray[np.float64]) -> tuple[float, float]:
    """Slope of a straight line, and half its 95 % interval where errors near one another hang together."""
    away = t - t.mean()
    slope = float(away @ y / (away @ away))
    error = away * (y - y.mean() - slope * away)
    lags = max(len(t) // 10, 1)
    spread = error @ error + sum(2.0 * (1.0 - k / (lags + 1)) * (error[k:] @ error[:-k]) for k in range(1, lags + 1))
    return slope, 1.96 * float(np.sqrt(max(spread, 0.0))) / float(away @ away)
