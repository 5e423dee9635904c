"""A campaign that was run by one worker and left alone: what all others are compared with."""

from pathlib import Path

import pytest

import hil
from tests.campaigns.small import RUNS


@pytest.fixture(scope="session")
def swept(tmp_path_factory: pytest.TempPathFactory) -> hil.Sweep:
    return hil.sweep(RUNS, out=tmp_path_factory.mktemp("swept") / "alone", workers=1)


@pytest.fixture(scope="session")
def whole(swept: hil.Sweep) -> dict[str, bytes]:
    """Files of its results by name."""
    return bytes_in(swept.path)


def bytes_in(folder: Path) -> dict[str, bytes]:
    """Files of the results by name."""
    files = sorted(file for file in folder.glob("results/**/*") if file.is_file())
    return {str(file.relative_to(folder)): file.read_bytes() for file in files}
