"""Fixtures shared by the tests of records, score and report."""

import pytest

from tests.records.synthetic_run import Options, write_run


@pytest.fixture
def make_run(tmp_path):
    """Write a synthetic run; gives its folder and the path of its truth."""

    def make(**options):
        folder = tmp_path / "runs" / "20250314-092653-bench"
        truth = write_run(folder, Options(**options))
        return folder, truth

    return make
