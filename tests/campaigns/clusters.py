"""A Dask scheduler and workers as processes on this machine, to be killed at will."""

import os
import socket
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

QUIET = {"DASK_DISTRIBUTED__DASHBOARD__LINK": "", "DASK_LOGGING__DISTRIBUTED": "error"}


def free_port() -> int:
    """A port that nobody listens at."""
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        return int(listening.getsockname()[1])


class Cluster:
    """A scheduler at a port of its own, and the workers that were started for it."""

    def __init__(self, place: Path) -> None:
        self.port = free_port()
        self.address = f"tcp://127.0.0.1:{self.port}"
        self._place = place
        self.scheduler: subprocess.Popen[bytes] | None = None
        self.workers: list[subprocess.Popen[bytes]] = []

    def start_scheduler(self) -> None:
        """At the same address each time."""
        self.scheduler = self._start("scheduler", "--host", "127.0.0.1", "--port", str(self.port), "--no-dashboard")

    def start_worker(self) -> "subprocess.Popen[bytes]":
        """One thread, no nanny that would start it again."""
        worker = self._start(
            "worker", self.address, "--nthreads", "1", "--no-nanny", "--no-dashboard", "--local-directory",
            str(self._place / f"worker-{len(self.workers)}"),
        )  # fmt: skip
        self.workers.append(worker)
        return worker

    def _start(self, *arguments: str) -> "subprocess.Popen[bytes]":
        with (self._place / "dask.log").open("ab") as log:
            return subprocess.Popen(
                [sys.executable, "-m", "dask", *arguments], env=os.environ | QUIET, stdout=log, stderr=log
            )

    def end(self) -> None:
        """All of them."""
        for process in [*self.workers, *([self.scheduler] if self.scheduler else [])]:
            process.kill()
            process.wait()


def wait_for(cluster: Cluster) -> None:
    """Until the scheduler answers and what was connected to it before has had the time to connect again."""
    until = time.monotonic() + 60.0
    while time.monotonic() < until:
        with suppress(OSError), socket.create_connection(("127.0.0.1", cluster.port), timeout=1.0):
            time.sleep(5.0)
            return
        time.sleep(0.1)
    raise AssertionError("the scheduler did not come back")
