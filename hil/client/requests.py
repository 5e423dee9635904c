"""One request after another to a service, its refusals as InputError."""

import json
from pathlib import Path
from typing import Any

import httpx

from hil.errors import InputError

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

    def json(self, method: str, path: str, *, lease: str | None = None, **given: Any) -> Any:
        """The answer's JSON. Raises as `ask`."""
        return self.ask(method, path, lease=lease, **given).json()

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
