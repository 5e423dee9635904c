"""``hil run --live``: the run of a service that is there for this run alone, with its page."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from hil.boards.emulation import shown
from hil.cli.options import as_words
from hil.errors import InputError
from hil.options import chosen
from hil.progress import Progress, Watcher
from hil.running.options import FileOptions, LocalRunOptions, RunOptions
from hil.running.request import RunRequest

_END_S = 120.0


def run_live(request: RunRequest, options: LocalRunOptions, out: Path, progress: Watcher) -> Path:
    """The folder of the run, once it has ended; its consent has been given. Raises InputError where nothing was
    recorded.

    Ctrl-C ends the run well, and the service with it.
    """
    from hil.client import connect

    shared: Any = {name: value for name, value in chosen(RunOptions, options).items() if value is not None}
    with (
        _served(out, request.link, as_words(FileOptions, options)) as said,
        connect(said["links"]["administer"]) as service,
    ):
        print(f"live: {said['links']['administer']}", file=sys.stderr, flush=True)
        show_page(said["links"]["administer"])
        with service.board("hil run --live") as board:
            board.connect(shown(request.link))  # as a request names it: scenarios by name
            try:
                run = board.start(request.bench, arm=True, **shared).id
                _follow(service, run, progress)
            except KeyboardInterrupt:
                board.stop()
                _follow(service, service.state["run"], progress)
                raise
            if not (out / run).exists():
                raise InputError(f"nothing was recorded: {service.state['words']}")
            return out / run


def _follow(service: Any, run: str | None, progress: Watcher) -> None:
    for state in service.states():
        if state["run"] != run or run is None:
            return
        progress(Progress(state["stage"] or "run", state["done"], state["total"]))


@contextmanager
def _served(out: Path, link: str, more: list[str]) -> Iterator[dict[str, Any]]:
    # A session of its own: Ctrl-C comes here, and the service is told in its own way.
    process = subprocess.Popen(
        [sys.executable, "-m", "hil", "serve", "--port", "0", "--json", "--folder", str(out), "--link", link, *more],
        stdout=subprocess.PIPE,
        start_new_session=True,
    )
    assert process.stdout is not None
    try:
        line = process.stdout.readline()
        if not line:
            raise InputError("the service for --live did not start; its own line says why")
        yield json.loads(line)
    finally:
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(_END_S)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            print("hil: the service did not end, and was ended; its board's log is in .service", file=sys.stderr)
        process.stdout.close()


def show_page(url: str) -> None:
    """Open the page where there is a screen."""
    if os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        import webbrowser

        webbrowser.open(url)
