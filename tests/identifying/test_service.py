"""An identification by the service: an emulated board by its link, records by their runs, no board that may move."""

import json
from pathlib import Path

import pytest

import hil
from estimator.identify.derived import Constant
from hil.client import connect
from hil.errors import InputError
from hil.service.jobs.asked import AskedIdentify, AskedTrace, order_of
from hil.service.jobs.jobs import Jobs
from hil.service.jobs.uploads import Uploads
from tests.service.serving import serving


def ordered(place: Path, **asked: object) -> dict[str, object]:
    runs = place / "runs"
    return order_of(AskedIdentify(kind="identify", **asked), runs, lambda run: runs / run, Uploads(place / "uploads"))  # type: ignore[arg-type]


@pytest.mark.parametrize("link", ["serial:/dev/ttyACM0", "can:can0", "udp:239.0.0.1:4242", "inproc:../s-still"])
def test_a_job_drives_no_real_board(tmp_path: Path, link: str) -> None:
    with pytest.raises(InputError, match=r"identify a real one with hil identify, on its machine"):
        ordered(tmp_path, link=link)


def test_a_bench_file_that_is_there_stays(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="s-slow: there is such a bench file; give another name"):
        ordered(tmp_path, link="inproc:s-still", save="s-slow")
    assert str(ordered(tmp_path, link="inproc:s-still", save="mine")["save"]) == str(tmp_path / "mine.bench.toml")


def test_runs_that_a_job_reads_are_in_use(tmp_path: Path) -> None:
    runs = tmp_path / "runs"
    jobs = Jobs(tmp_path / "jobs", runs, told=lambda _: None, made=lambda _: None, at_once=1)
    jobs._at_once = 0  # it waits
    try:
        for asked in (AskedIdentify(kind="identify", run=("a", "b")), AskedTrace(kind="trace", run="a")):
            order = order_of(asked, runs, lambda run: runs / run, Uploads(tmp_path / "uploads"))
            jobs.add(order, {"kind": asked.kind}, by="tester")
        assert len(jobs.using("a")) == 2
        assert len(jobs.using("b")) == 1
        assert jobs.using("c") == []
    finally:
        jobs.close()


@pytest.mark.slow
def test_the_client_has_a_board_identified_and_run_by_the_file(tmp_path: Path) -> None:
    with serving(tmp_path / "runs") as service, connect(service.url, service.token()) as client:
        with pytest.raises(InputError, match="give the link of a board, or --record RUN, one of the two"):
            client.identify()
        done = client.identify("inproc:s-still", save="mine", mass_kg=5e-7, name="still")
        assert done["found"]["faults"] == []
        assert done["found"] == json.loads((tmp_path / "runs" / done["run"] / "identified.json").read_text())
        assert done["bench"] == "mine"
        assert isinstance(hil.load_bench(tmp_path / "mine.bench.toml"), hil.Bench)
        ran = client.load(client.job("run", bench="mine", link="inproc:s-still")["result"]["run"])
        assert ran.result.verdict == "good"
        again = client.identify(run=ran, mass_kg=5e-7)
        assert again["bench"] is None
        assert again["found"]["constants"]["kxx"]["value"] == pytest.approx(done["found"]["constants"]["kxx"]["value"])


def test_what_no_record_tells_is_null() -> None:
    from hil.identifying.findings import _told

    told = _told(Constant("q_1", float("nan"), float("inf"), "1"))
    assert told == {"name": "q_1", "value": None, "u": None, "unit": "1", "expanded_u": None}
