"""The example board on a Cortex-M7, which QEMU emulates: built for it, started, its UART on a pty."""

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from hil.doctor.machine import NEEDED

MPS2 = Path(__file__).parents[2] / "firmware" / "mps2"
REQUIRED = "HIL_REQUIRE_QEMU"


def require() -> None:
    """Skip the test where the packages are missing, unless the environment says that it may not be skipped."""
    missing = [packages for command, _, packages in NEEDED if shutil.which(command) is None]
    if not missing:
        return
    reason = f"sudo apt install {' '.join(missing)}"
    if os.environ.get(REQUIRED) == "1":
        pytest.fail(f"{REQUIRED} is set, but packages are missing: {reason}")
    pytest.skip(reason)


@contextmanager
def mps2_board(built: Path, *options: str) -> Iterator[str]:
    """The link of an emulated board that runs `mps2_board.elf`."""
    command = [str(MPS2 / "qemu"), str(built / "mps2_board.elf"), *options]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        ready, _, url = process.stdout.readline().strip().partition(" ")
        assert ready == "ready"
        yield url
    finally:
        process.terminate()
        process.communicate()
