"""The same telemetry for other people's viewers, by Foxglove's WebSocket protocol and its published SDK.

A topic for each record of the run, with lowest and highest value of each channel since the message before, forty times
a second, and one each for the board's state and what the observer says, ten times a second.  Times are bench times.
It can only be looked at; everybody who reaches the port can look.
"""

from typing import TYPE_CHECKING, Any

import numpy as np

from hil.errors import InputError
from hil.service.telemetry.views import Tracks

if TYPE_CHECKING:
    from foxglove.websocket import WebSocketServer

_SCHEMA = {"type": "object"}
_RECORDS = ("capture", "innovation", "estimates")
_TOPICS = ("/board", "/now", *(f"/{record}" for record in _RECORDS))


class Viewers:
    """A server on this machine's loopback. Raises InputError where the SDK is not there, or the port is taken."""

    def __init__(self, port: int) -> None:
        try:
            import foxglove
        except ImportError:
            raise InputError("--foxglove: its SDK is missing; pip install 'gyrohil[viewers]'") from None
        self._context = foxglove.Context()
        try:
            self._server: WebSocketServer = foxglove.start_server(
                name="gyrohil", host="127.0.0.1", port=port, context=self._context
            )
        except (RuntimeError, OSError, ValueError) as error:
            raise InputError(f"--foxglove {port}: {error}; give another port, 0 for any that is free") from None
        # All of them before anybody connects: one that is opened while a viewer connects may not be told to it.
        self._channels = {topic: foxglove.Channel(topic, schema=_SCHEMA, context=self._context) for topic in _TOPICS}

    @property
    def port(self) -> int:
        return int(self._server.port)

    def looked(self, tracks: Tracks) -> None:
        """What the last look at the rings brought."""
        said: dict[str, dict[str, Any]] = {}
        last = 0
        for name, channel in tracks.channels.items():
            track = tracks.get(channel.track)
            if track is None or not len(track.new) or channel.track not in _RECORDS:
                continue
            values = channel.values(track.new)
            values = values[np.isfinite(values)]
            last = max(last, int(track.new["tick"][-1]))
            if values.size:
                of_track = said.setdefault(channel.track, {})
                short = name.partition(".")[2]
                of_track[short] = float(values[-1])
                of_track[f"{short}_min"], of_track[f"{short}_max"] = float(values.min()), float(values.max())
        for track_name, message in said.items():
            self._log(f"/{track_name}", message, last / tracks.rate_Hz)

    def state(self, state: dict[str, Any]) -> None:
        """The board's state, and what the observer says."""
        now = state["now"]
        shown = {
            name: state[name] for name in ("connected", "lost", "link", "state", "reason", "words", "run", "stage")
        }
        seconds = 0.0 if now is None else float(now["t_s"])
        self._log("/board", {**shown, "health": state["health"]}, seconds)
        if now is not None:
            self._log("/now", now, seconds)

    def close(self) -> None:
        self._server.stop()

    def _log(self, topic: str, message: dict[str, Any], seconds: float) -> None:
        self._channels[topic].log(message, log_time=round(1e9 * max(seconds, 0.0)))
