"""Smaller promises of the wire: claims, stamps, frames in one step, what is closed (docs/wire.md)."""

import os
from pathlib import Path

import pytest

from hil.wire.errors import LinkClosed, LinkError
from hil.wire.link import Claim
from hil.wire.pty_link import open_pty


def descriptors() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


def test_a_name_is_held_by_one_and_free_when_released() -> None:
    name = f"test-{os.getpid()}"
    first = Claim(name, "can:x", "end the other")
    before = descriptors()
    for _ in range(3):
        with pytest.raises(LinkError, match="can:x: end the other"):
            Claim(name, "can:x", "end the other")
    assert descriptors() == before  # who is refused leaves nothing open
    first.release()
    first.release()
    Claim(name, "can:x", "end the other").release()


def test_a_closed_descriptor_is_nobodys() -> None:
    """Closed twice it does not close another that took its number."""
    link = open_pty()
    link.close()
    assert link.fileno() == -1
    other = os.open(os.devnull, os.O_RDONLY)
    try:
        link.close()
        os.fstat(other)
        os.fstat(0)
    finally:
        os.close(other)
    with pytest.raises(LinkClosed, match="closed"):
        link.offer(b"\0")
