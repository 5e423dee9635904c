"""Memory does not grow with the record: four times as long, about the same peak."""

from pathlib import Path

import pytest

from tests.records.long_run import peak_bytes, write_long_run

SHORT_S, LONG_S = 20.0, 80.0
GROWTH = 1.2


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[Path, Path]]:
    """The short run and the long one, each a folder and its truth."""
    return [write_long_run(tmp_path_factory.mktemp("run"), seconds) for seconds in (SHORT_S, LONG_S)]


@pytest.mark.beyond(1)
@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("verb", ["check", "score", "export csv", "export parquet"])
def test_four_times_as_long_takes_no_more_memory(runs: list[tuple[Path, Path]], tmp_path: Path, verb: str) -> None:
    peaks = []
    for number, (folder, truth) in enumerate(runs):
        command, _, form = verb.partition(" ")
        more = {
            "check": [],
            "score": ["--truth", str(truth)],
            "export": ["--to", form, "-o", str(tmp_path / f"out{number}")],
        }[command]
        peaks.append(peak_bytes(command, str(folder), *more))
    assert peaks[1] < GROWTH * peaks[0], peaks
