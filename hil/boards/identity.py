"""Who a board says it is, as a bench file declares it."""

from typing import Any

from hil.bench.template import IN_MPS2
from hil.boards.emulation import served
from hil.wire import client
from hil.wire.endpoint import Endpoint
from hil.wire.links import open_link
from hil.wire.messages import Identity


def identity_at(link: str) -> Identity:
    """Who the board at `link` is."""
    with served(link) as board:
        endpoint = Endpoint(open_link(board.url))
        try:
            return client.connect(endpoint)
        finally:
            endpoint.close()


def from_identity(link: str) -> tuple[str, dict[str, dict[str, Any]], dict[str, Any]]:
    """Ask the board at `link` who it is: (a heading for a bench file, the values it declares by section, its IDENTITY
    by field)."""
    identity = identity_at(link)
    heading = f"Board {identity.unique_id:016x}, firmware {identity.version}."
    drive = identity.drive_scale_mps2 * 2 ** (identity.drive_bits - 1)
    told: dict[str, dict[str, Any]] = {
        "device": {"axes": identity.axes, "sample_rate_Hz": identity.tick_rate_Hz},
        "device.drive": {"full_scale": drive, **IN_MPS2},
    }
    if not link.startswith("pty:"):
        told["link"] = {"url": link}
    return heading, told, identity._asdict()
