"""One service for all tests of a module that leave it as they found it."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.service.serving import Serving, serving


@pytest.fixture(scope="session")
def source(whole_run: Path) -> Path:
    """What a service has to show."""
    return whole_run


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Serving]:
    """A service with an empty folder."""
    with serving(tmp_path_factory.mktemp("bench") / "runs") as running:
        yield running
