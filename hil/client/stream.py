"""The live connection of a service: the board's state as it is told, and frames of a run that lasts."""

import json
from collections.abc import Iterator, Mapping
from typing import Any, Self

from hil.errors import InputError
from hil.records.frame import Frame

_SILENT_S = 10.0  # the state comes several times a second


class Stream:
    """One connection; for a `with`."""

    def __init__(self, url: str, token: str) -> None:
        from websockets.sync.client import connect

        try:
            self._socket = connect(f"ws{url.removeprefix('http')}/api/live", max_size=None)
        except (OSError, ValueError, TimeoutError) as error:
            raise InputError(f"{url}: the service does not answer ({error}); is `hil serve` running?") from None
        self.say(op="hello", token=token)

    def say(self, **message: Any) -> None:
        """A request: subscribe, unsubscribe, pattern, spectrum, safe."""
        self._socket.send(json.dumps(message))

    def received(self) -> Iterator[Frame | dict[str, Any]]:
        """What comes, frames and messages. Raises InputError when the service is gone."""
        from websockets.exceptions import ConnectionClosed

        while True:
            try:
                data = self._socket.recv(timeout=_SILENT_S)
            except (ConnectionClosed, TimeoutError) as error:
                why = getattr(getattr(error, "rcvd", None), "reason", "") or "it does not answer any more"
                raise InputError(f"the live connection ended: {why}") from None
            yield json.loads(data) if isinstance(data, str) else Frame.of(data)

    def states(self) -> Iterator[dict[str, Any]]:
        """The board's state, as it comes."""
        for said in self.received():
            if isinstance(said, dict) and said["kind"] == "state":
                yield said

    def frames(self, request: Mapping[str, Any]) -> Iterator[Frame]:
        """The frames of one request, until the run ends. Raises InputError where it is refused."""
        self.say(id=1, **request)
        began = False
        for said in self.received():
            if isinstance(said, Frame):
                began = True
                yield said
            elif said["kind"] == "error":
                raise InputError(f"{said['error']}; {said['remedy']}")
            elif said["kind"] == "state" and began and said["run"] is None:
                return

    def close(self) -> None:
        """Hang up."""
        self._socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
