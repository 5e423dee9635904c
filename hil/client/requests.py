"""One request after another to a service, its refusals as InputError."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Self

import httpx

from hil.errors import InputError
from hil.records.frame import Frame

FOUND_BY = Path(".service") / "serve.json"
"""Where a service says where it is, in the folder of its runs."""
_PATIENCE_S = 200.0  # longer than the service waits for a board that has to be started


class Requests:
    """Requests to `url` with a token."""

    def __init__(self, url: str, token: str, verify: bool | str) -> None:
        self.url, self.token = url.rstrip("/"), token
        self._client = httpx.Client(
            base_url=self.url, headers={"Authorization": f"Bearer {token}"}, timeout=_PATIENCE_S, verify=verify
        )

    def ask(self, method: str, path: str, *, lease: str | None = None, **given: Any) -> httpx.Response:
        """One request. Raises InputError with what the service says to it, or that it does not answer."""
        headers = {} if lease is None else {"X-Lease": lease}
        try:
            answer = self._client.request(method, path, headers=headers, **given)
        except httpx.HTTPError as error:
            raise InputError(f"{self.url}: the service does not answer ({error}); is `hil serve` running?") from None
        if answer.is_success:
            return answer
        try:
            said = answer.json()
            line = "; ".join(part for part in (said["error"], said.get("remedy")) if part)
        except (ValueError, KeyError, TypeError):
            line = f"{method} {path}: {answer.status_code} {answer.reason_phrase}"
        raise InputError(line)

    def json(self, method: str, path: str, *, lease: str | None = None, **given: Any) -> dict[str, Any]:
        """The answer's JSON, an object. Raises as `ask`."""
        answer: dict[str, Any] = self.ask(method, path, lease=lease, **given).json()
        return answer

    def close(self) -> None:
        """No more requests."""
        self._client.close()


def found(folder: Path) -> tuple[str, str]:
    """Address and token of the service whose runs are in `folder`. Raises InputError where none runs there."""
    place = folder / FOUND_BY
    try:
        entry = json.loads(place.read_text())
        return str(entry["url"]), str(entry["token"])
    except FileNotFoundError:
        raise InputError(
            f"{folder}: no service runs there; start one with hil serve, or give its address and token"
        ) from None
    except (OSError, ValueError, KeyError, TypeError):
        raise InputError(f"{place}: cannot be read; give the service's address and token") from None


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
