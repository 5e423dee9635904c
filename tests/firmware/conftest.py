"""The C side, built once by the system's compiler, warnings as errors."""

import ctypes
import os
import subprocess
from pathlib import Path

import pytest

from tests.made_once import made_once

FIRMWARE = Path(__file__).parents[2] / "firmware"


def make(place: Path, *targets: str) -> Path:
    """Build into `place`, which is returned."""
    # What a make around the tests was told, such as -n, is not meant for this one.
    told = ("MAKEFLAGS", "MFLAGS", "MAKELEVEL")
    environment = {name: value for name, value in os.environ.items() if name not in told}
    command = ["make", "--silent", "-C", str(FIRMWARE), f"BUILD={place}", *targets]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return place


@pytest.fixture(scope="session")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the library and the example board."""
    return made_once(tmp_path_factory, "firmware", lambda place: make(place, "all", "shared"))


@pytest.fixture(scope="session")
def library(built: Path) -> ctypes.CDLL:
    """The library, loaded."""
    return ctypes.CDLL(str(built / "libhil.so"))
