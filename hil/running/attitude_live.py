"""The attitude while the runs last, as a page of its own on this machine: read from the records as they grow.

It stands beside the loops and never between them and their boards. The address has a word that nobody can guess;
nothing can be changed by it.
"""

import json
import math
import secrets
import threading
import time
from collections.abc import Callable, Sequence
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from scipy.interpolate import CubicSpline

from estimator.attitude import Attitude, attitude
from hil.bench.mount import Mount
from hil.errors import InputError
from hil.records.runfolder import RunFolder

_PERIOD_S = 0.5
_SHARE = 4.0  # so many times as long as it took to work an attitude out, it waits for the next


class LiveAttitude:
    """A server of the newest attitude for the length of the block.

    Attributes:
        url: where its page is.
        newest: what the page shows, JSON values.
    """

    def __init__(self, runs: Callable[[], Sequence[Path]], mount: Mount) -> None:
        self._runs, self._mount = runs, mount
        self.newest: dict[str, Any] = {"without": "the runs have not begun"}
        self._end = threading.Event()
        word = secrets.token_urlsafe(16)
        self._server = ThreadingHTTPServer(("127.0.0.1", 0), _handler(self, word))
        self._server.daemon_threads = True
        self.url = f"http://127.0.0.1:{self._server.server_port}/{word}/"
        self._threads = [
            threading.Thread(target=self._server.serve_forever, name="attitude-page", daemon=True),
            threading.Thread(target=self._follow, name="attitude", daemon=True),
        ]

    def __enter__(self) -> Self:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self._server.shutdown()
        self._server.server_close()
        for thread in self._threads:
            thread.join()

    def _follow(self) -> None:
        took_s = 0.0
        while not self._end.wait(max(_PERIOD_S, _SHARE * took_s)):
            began = time.monotonic()
            try:
                found = together([RunFolder(run) for run in self._runs()], self._mount)
            except (InputError, OSError, ValueError) as error:  # of a record whose newest block is being written, too
                self.newest = {**self.newest, "without": str(error)}
                continue
            self.newest = {"without": "", **found.figures, "angles_rad": found.angles[-1].tolist()}
            took_s = time.monotonic() - began


def _handler(live: LiveAttitude, word: str) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            if self.path == f"/{word}/attitude.json":
                self._answer("application/json", json.dumps(live.newest).encode())
            elif self.path == f"/{word}/":
                self._answer(
                    "text/html; charset=utf-8", files("hil.running").joinpath("attitude_live.html").read_bytes()
                )
            else:
                self.send_error(404)

        def _answer(self, kind: str, body: bytes) -> None:
            self.send_response(200)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(body)))
            self.send_header("Cache-Control", "no-store")
            self.send_header("X-Content-Type-Options", "nosniff")
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_: Any) -> None:
            """Nothing is said of requests."""

    return Handler


LEAST_ROWS = 9


class OnOneClock(NamedTuple):
    """The angle of one gyro: times (n,) on the common clock, angle and its standard uncertainty (n,), and the standard
    uncertainty of these times, None in lockstep, where bench times are one."""

    t_s: np.ndarray
    angle: np.ndarray
    u: np.ndarray
    clock_u_s: float | None


class Together(NamedTuple):
    """The attitude and what it is made of, angles (n, 3) and deviations (n, 3) at its instants."""

    attitude: Attitude
    angles: np.ndarray
    deviations: np.ndarray
    rate_Hz: float
    start_s: float
    clock_u_s: tuple[float | None, ...]

    @property
    def figures(self) -> dict[str, Any]:
        """What stands at its end, as in attitude.json."""
        found = self.attitude
        return {
            "seconds": float(found.time_s[-1]),
            "quaternion": tuple(found.quaternion[-1].tolist()),
            "u_rad": float(found.deviation[-1]),
            "coning_rad": float(np.linalg.norm(found.coning[-1])),
        }


def on_one_clock(run: RunFolder) -> OnOneClock:
    """The scored angle of a run; InputError where it has none, or where its board's clock is unknown."""
    estimates = run.estimates
    if estimates is None or "angle_rad" not in estimates:
        raise InputError(f"{run.path.name}: no angle is recorded")
    scored = estimates.settled(run.settle_s)
    if len(scored) < LEAST_ROWS:
        raise InputError(f"{run.path.name}: its scored window is too short for an attitude")
    t_s, u_s = scored.t_s, None
    if run.clock is None:  # lockstep: from tick to tick of the run
        t_s = t_s - estimates.ends_s[0]
    else:
        if (fit := run.clock.fit) is None:
            raise InputError(f"{run.path.name}: {run.clock.unknown}, so that its time is not that of the others")
        # Ticks count on the board's clock: by the exchanges, which say both, between a tick and the next.
        ahead = run.clock.columns["board_ns"] - np.round(run.clock.t_s * 1e9).astype(np.int64)
        board_ns = np.round(t_s * 1e9).astype(np.int64) + int(np.median(ahead)) - round(0.5e9 / run.clock.tick_rate_Hz)
        t_s = (fit.host_ns(board_ns) + fit.at_host_ns) * 1e-9
        u_s = math.hypot(1e-9 * fit.offset_uncertainty_ns, 0.3 / run.clock.tick_rate_Hz)
    u = np.asarray(scored["angle_u_rad"])
    if run.result is not None and run.result.angle_u_rad is not None and u[-1] > 0.0:
        u = u * (run.result.angle_u_rad / u[-1])  # what the closing scan left of what was declared
    return OnOneClock(t_s, np.asarray(scored["angle_rad"]), u, u_s)


def together(runs: list[RunFolder], mount: Mount) -> Together:
    """The attitude while all three were scored. Raises InputError: why there is none."""
    if len(runs) != 3:
        raise InputError("an attitude needs three gyros")
    each = [on_one_clock(run) for run in runs]
    begin, end = max(one.t_s[0] for one in each), min(one.t_s[-1] for one in each)
    step = max(float(np.median(np.diff(one.t_s))) for one in each)
    if not end - begin > LEAST_ROWS * step:
        raise InputError("the scored windows of the three runs do not overlap")
    t_s = begin + step * np.arange(int((end - begin) / step * (1.0 + 1e-9)) + 1)
    angles, deviations = [], []
    for one in each:
        spline = CubicSpline(one.t_s, one.angle)
        angle, late = spline(t_s), spline(t_s, 1) * (one.clock_u_s or 0.0)
        angles.append(angle - angle[0])
        deviations.append(np.hypot(np.interp(t_s, one.t_s, one.u), late))
    found = attitude(t_s - begin, np.column_stack(angles), np.column_stack(deviations), mount.matrix, mount.u_rad)
    rows = 2 * np.arange(len(found.time_s))
    return Together(
        attitude=found,
        angles=np.column_stack(angles)[rows],
        deviations=np.column_stack(deviations)[rows],
        rate_Hz=0.5 / step,
        start_s=begin,
        clock_u_s=tuple(one.clock_u_s for one in each),
    )
