"""A disk that fails while a run writes to it: the run ends in one line, the board is SAFE, the rest is readable."""

import shutil
from collections.abc import Iterator

import pytest

from tests.records.failing_disk import FAULTS
from tests.records.failing_disk.campaign import WAYS, Campaign

pytestmark = [
    pytest.mark.long,  # a full disk while the loop runs: tests/running/test_record_ends.py
    pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler"),
]

PLACES = {
    "the folder": "mkdir",
    "the bench file": "rename /runs/RUN/bench.toml",
    "a header": "write /runs/RUN/innovation.arrow",
    "the end of the capture": "fsync /runs/RUN/capture.arrow",
    "the end of the last file": "fsync /runs/RUN/timing.arrow",
    "the result": "rename /runs/RUN/result.json",
    "the report": "write /runs/RUN/.report.html",
}


@pytest.fixture(scope="module", params=WAYS)
def failing(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Campaign]:
    place = tmp_path_factory.mktemp("failing")
    with Campaign(place, request.param).board() as campaign:
        campaign.reach()
        yield campaign


def number_of(calls: list[str], beginning: str) -> int:
    """Number of the first call that begins so, whatever the run is called."""
    kind, *place = beginning.split("RUN")
    for number, call in enumerate(calls, 1):
        said, path = call.split(" ", 1)
        where = "/runs/" + path.partition("/runs/")[2].partition("/")[2]
        if said == kind.split()[0] and (not place or where.startswith("/runs" + place[0])):
            return number
    raise AssertionError(f"{beginning}: not among {calls}")


@pytest.mark.parametrize("place", PLACES)
def test_a_full_disk(failing: Campaign, place: str) -> None:
    outcome = failing.fail("disk full", number_of(failing.calls, PLACES[place]))
    assert outcome.hit
    assert not outcome.wrong, outcome


@pytest.mark.parametrize("fault", [name for name in FAULTS if name != "disk full"])
def test_every_other_way_to_fail_in_the_middle_of_the_record(failing: Campaign, fault: str) -> None:
    blocks = [number for number, call in enumerate(failing.calls, 1) if call.startswith("write") and "capture" in call]
    outcome = failing.fail(fault, blocks[2])
    assert outcome.hit
    assert not outcome.wrong, outcome
