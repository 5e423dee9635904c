"""A virtual CAN interface, which few kernels bring: `make test-vcan` provides one."""

import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from hil.wire.can_link import interfaces

NAME = "vcan0"


@pytest.fixture(scope="session", autouse=True)
def vcan() -> str:
    """Its name; tests are skipped where it is not there."""
    if NAME not in interfaces():
        pytest.skip(f"no {NAME} on this machine; `make test-vcan` brings one up")
    return NAME


@pytest.fixture(scope="session")
def ip():
    """The `ip` command, for what only root may do to an interface."""
    if os.geteuid() != 0:
        pytest.skip("only root may touch an interface")

    def run(*arguments: str) -> None:
        subprocess.run(["ip", *arguments], check=True)

    return run


@pytest.fixture(autouse=True)
def restored(request: pytest.FixtureRequest) -> Iterator[None]:
    """The interface is up, with CAN FD, after every test that could touch it."""
    yield
    if "ip" in request.fixturenames:
        run = request.getfixturevalue("ip")
        run("link", "set", NAME, "down")
        run("link", "set", NAME, "mtu", "72", "up")


@pytest.fixture(scope="session")
def c_board() -> Path:
    """The C board's program."""
    program = os.environ.get("HIL_PTY_BOARD", "")
    if not program:
        pytest.skip("the C board is not built; `make test-vcan` builds it where there is a compiler")
    return Path(program)
