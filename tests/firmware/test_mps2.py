"""The C library on a Cortex-M7 in QEMU: the same bytes as on the host, and a run that is good."""

from pathlib import Path

import pytest

from hil.bench import load_bench, override
from hil.wire.messages import Arm, DriveForce, Message, SafeReason
from hil.wire.messages import Safe as GoSafe
from tests.made_once import made_once

from .conftest import make
from .mps2 import mps2_board, require
from .process import Host, pty_board, rows
from .test_run import EXAMPLES, SLOW, check, ran

pytestmark = [pytest.mark.slow]


@pytest.fixture(scope="session")
def cross_built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the board's program, for the Cortex-M7."""
    require()
    return made_once(tmp_path_factory, "mps2", lambda place: make(place, "mps2"))


def sensed(url: str, samples: int) -> list[list[int]]:
    """Rows of a board under a drive that is the same each time; it is left in SAFE.

    Answers to HELLO may come late: QEMU looks once a second whether somebody has opened its pty.
    """
    host = Host(url)
    try:
        heard = asked(host, Arm())
        while len(heard) < samples:
            m = len(heard) - 1
            heard += asked(host, DriveForce(m * 97 % 4001 - 2000, m * 61 % 3001 - 1500, m + 1))
        host.endpoint.send(GoSafe(SafeReason.HOST_REQUEST))
    finally:
        host.close()
    return heard


def asked(host: Host, message: Message) -> list[list[int]]:
    """The next rows after a message."""
    host.endpoint.send(message)
    while not (heard := rows(host.hear())):
        pass
    return heard


def test_the_board_says_the_same_on_both_processors(built: Path, cross_built: Path) -> None:
    with pty_board(built) as (_, here), mps2_board(cross_built) as there:
        assert sensed(there, 200) == sensed(here, 200)


def test_it_serves_one_host_after_another(cross_built: Path) -> None:
    with mps2_board(cross_built) as url:
        first, second = sensed(url, 20), sensed(url, 20)
    assert len(first) == len(second) == 20
    assert first != second  # the mass has moved on


@pytest.mark.usefixtures("no_report")
def test_a_run_is_good_and_right(cross_built: Path, tmp_path: Path) -> None:
    declared = load_bench(EXAMPLES / "c-board.bench.toml")
    shorter = override(declared, {"loop": {"duration_s": 6.0, "settle_s": 3.0}}, "test")
    with mps2_board(cross_built) as url:
        folder = ran(shorter, url, tmp_path)
    check(folder, SLOW, 1.0, 3.0, 5e-3)
