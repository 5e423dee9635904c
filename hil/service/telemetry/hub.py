"""The one reader of a run's rings in this service, whatever the number of clients."""

import asyncio
import logging
import math
import os
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np

from hil.numbers import COVERAGE
from hil.records.estimates import steady
from hil.service.telemetry.deadlines import Deadlines
from hil.service.telemetry.views import Rolls, Track, Tracks

LOOKS_PER_S = 50.0
_LOG = logging.getLogger(__name__)


class Hub:
    """Looks at the rings, and wakes those that wait for news.

    Attributes:
        tracks: of the run that lasts or was the last one.
        rolls: decimated channels of it.
        run: counts the runs: views of another one are made anew.
        looked: called after each look that brought something.
        live: whether a run lasts.
    """

    def __init__(self) -> None:
        self.tracks, self.rolls, self.now = Tracks(), Rolls(), Now()
        self.run = 0
        self.looked: set[Callable[[], None]] = set()
        self.live = False

    def attach(self, stem: str, layout: dict[str, Any], descriptor: int) -> None:
        """A ring of the run that begins; `descriptor` is closed."""
        try:
            if not self.live:
                self.detach()
                self.tracks, self.rolls, self.now = Tracks(), Rolls(), Now()
                self.run += 1
                self.live = True
            with suppress(OSError, ValueError):
                self.tracks.add(stem, layout, descriptor)
        finally:
            os.close(descriptor)

    def end(self) -> None:
        """The run has ended: what is still in its rings is looked at once more."""
        if self.live:
            try:
                self.look()
            finally:
                self.live = False

    @property
    def ready(self) -> bool:
        """Whether a run lasts whose rings are all there: that of the times comes after what is drawn."""
        return self.live and self.tracks.get("timing") is not None

    def detach(self) -> None:
        """Let the rings go: nothing is looked at until others are attached."""
        self.live = False
        self.tracks.close()

    def look(self) -> None:
        if not self.live or not self.tracks.look():
            return
        self.rolls.add_new(self.tracks)
        self.now.look(self.tracks)
        for act in list(self.looked):
            act()

    async def follow(self) -> None:
        """Look for as long as the service lives."""
        clock = asyncio.get_running_loop().time
        due = clock()
        while True:
            try:
                self.look()
            except Exception:  # noqa: BLE001 - clients would go on being shown what was
                _LOG.exception("the new rows of the run could not be read; it is tried again")
            due = max(due + 1.0 / LOOKS_PER_S, clock())
            await asyncio.sleep(due - clock())


_LOOKED_S = 1.0  # over which powers and peaks are taken
_INNOVATION_S = 0.5


class Now:
    """Told each look, asked a few times a second."""

    def __init__(self) -> None:
        self._first: int | None = None
        self._last = 0
        self._samples = 0
        self._deadlines = Deadlines()
        self._heard_s = time.monotonic()

    def look(self, tracks: Tracks) -> None:
        """Count what the tracks' last look brought."""
        capture, timing = tracks.get("capture"), tracks.get("timing")
        if capture is not None and len(rows := capture.new):
            self._heard_s = time.monotonic()
            if self._first is None:
                self._first = int(rows["tick"][0])
            self._last = int(rows["tick"][-1])
            self._samples += len(rows)
        self._deadlines.look(capture, timing)

    def health(self, tracks: Tracks) -> dict[str, Any]:
        """Link and deadlines: samples seen and missing between two ticks; `held`, those at which the board held its
        drive for want of an answer, by its own word; `late`, samples whose answer reached the board after its effective
        tick, as result.json counts them; the time from a sample's arrival to its answer over the last second.
        """
        if self._first is None:
            return {}
        seen = sum(track.passed_over for track in tracks if track.layout.kind == "capture")
        missing = self._last - self._first + 1 - self._samples - seen
        told: dict[str, Any] = {
            "samples": self._samples + seen,
            "lost": max(missing, 0),
            "silent_s": round(time.monotonic() - self._heard_s, 2),
            **self._deadlines.told(),
        }
        if (timing := tracks.get("timing")) is not None:
            rows = timing.kept.newest(1 << 13)
            rows = rows[rows["tick"] > self._last - _LOOKED_S * tracks.rate_Hz]
            if len(rows):
                turn = (rows["t_send_ns"] - rows["t_receive_ns"]) * 1e-3
                p50, p99 = np.percentile(turn, [50, 99])
                told["turnaround_us"] = {"p50": round(p50, 1), "p99": round(p99, 1), "max": round(float(turn.max()), 1)}
        return told

    def run(self, tracks: Tracks) -> dict[str, Any] | None:
        """Bench time, how much of it since the run's first sample, angle, rate, estimates, innovation, drive, and the
        voltages of trim outputs; None before the first sample.
        """
        if self._first is None:
            return None
        # The ticks of a board that has run before go on counting: how far this run is, is told apart from bench time.
        elapsed_s = (self._last - self._first + 1) / tracks.rate_Hz
        told: dict[str, Any] = {
            "t_s": self._last / tracks.rate_Hz,
            "elapsed_s": elapsed_s,
            "samples": self._samples,
        }
        if (estimates := tracks.get("estimates")) is not None:
            told |= _estimates(estimates)
        if (innovation := tracks.get("innovation")) is not None:
            told["innovation"] = _innovation(innovation, round(_INNOVATION_S * tracks.rate_Hz))
        if (capture := tracks.get("capture")) is not None:
            told["drive"] = _drive(capture, round(_LOOKED_S * tracks.rate_Hz))
        if (trims := tracks.get("trims")) is not None and len(rows := trims.kept.newest(1)):
            told["trims"] = {
                one["name"]: {"volts": float(rows[0][f"{one['name']}_V"]), "most_V": float(one["most_V"])}
                for one in trims.layout.header["outputs"]
            }
        return {name: _finite(value) for name, value in told.items()}


def _estimates(track: Track) -> dict[str, Any]:
    rows = track.kept.newest(1)
    if not len(rows):
        return {}
    row = rows[0]
    units = {column.name: column.unit for column in track.layout.columns}
    names = track.layout.header["states"]
    told: dict[str, Any] = {"estimates": {name: [float(row[name]), _given(row, name), units[name]] for name in names}}
    if "rate_rad_s" in names:
        told |= {"rate_rad_s": float(row["rate_rad_s"]), "rate_u": _given(row, "rate_rad_s")}
    if "angle_rad" in units:
        told |= {name: float(row[name]) for name in ("angle_rad", "angle_u_rad", "energy_ratio", "quadrature_ratio")}
        told["angle_expanded_rad"] = COVERAGE * told["angle_u_rad"]
        told["valid"] = bool(row["valid"])
    return told


def _given(row: Any, name: str) -> float | None:
    """Standard deviation of an estimate; None where the observer gives none, or takes the value as declared."""
    deviation = float(row[f"sd_{name}"])
    return deviation if deviation > 0.0 else None


def _innovation(track: Track, count: int) -> dict[str, Any]:
    rows = track.kept.newest(min(count, 1 << 15))
    names = [name for name in rows.dtype.names or () if name.endswith("_V")]
    measured = [name for name in names if not name.startswith(("sd_", "s_"))]
    predicted = [name for name in names if name not in measured]
    if not len(rows) or not measured or not predicted:
        return {}
    sd = np.stack([rows[name] for name in predicted], 1).astype(float)
    usual = np.median(sd, axis=0)
    sure = steady(sd, usual)  # behind a gap the prediction is wide, and what comes then is large by right
    if not sure.any():
        return {}
    nu = np.stack([rows[name] for name in measured], 1).astype(float)[sure]
    rms, expected = math.sqrt(float(np.mean(nu**2))), math.sqrt(float(np.mean(usual**2)))
    return {"rms_V": rms, "predicted_V": expected, "ratio": rms / expected if expected else None}


def _drive(track: Track, count: int) -> dict[str, Any]:
    rows = track.kept.newest(min(count, 1 << 15))
    told: dict[str, Any] = {}
    for column in track.layout.columns:
        if column.name.startswith("u") and column.name.endswith("_code"):
            codes = rows[column.name].astype(float)
            told["unit"] = column.unit
            told[f"rms_{column.name[1]}"] = float(np.sqrt(np.mean(np.square(codes)))) * column.scale
            told[f"peak_{column.name[1]}"] = float(np.abs(codes).max()) * column.scale
    identity = track.layout.header.get("identity", {})
    if "drive_bits" in identity:
        told["full_scale"] = (2 ** (identity["drive_bits"] - 1) - 1) * float(identity["drive_scale_mps2"])
    return told


def _finite(value: Any) -> Any:
    """As JSON can say it: what is no number, as of an observer that diverged, is null."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _finite(one) for key, one in value.items()}
    if isinstance(value, list):
        return [_finite(one) for one in value]
    return value
