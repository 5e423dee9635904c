"""`python -m evaluation.undeclared` as a campaign: killed it goes on, and comes to what was come to without."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from evaluation.undeclared.__main__ import main
from evaluation.undeclared.campaign import Records, carried_out, judgements
from evaluation.undeclared.judging import judge
from evaluation.undeclared.population import Order, population
from evaluation.undeclared.record import make
from evaluation.undeclared.summary import summarise
from hil.errors import InputError
from hil.sweeping.tasks import Task
from tests.campaigns.clusters import Cluster, free_port
from tests.campaigns.conftest import bytes_in

SAMPLES = 6_000
ORDERS = [Order("clean", (), 0, draw=2), Order("single", ("cubic_stiffness",), 1, draw=2)]
WAIT_S = 300.0


def records(folder: Path, **changes: bool) -> Records:
    return Records(ORDERS, folder, SAMPLES, **changes)


def silent(_: object) -> None: ...


def command(folder: Path, *more: str) -> list[str]:
    return [
        *("all", "--n", "6", "--draw", "2", "--samples", str(SAMPLES), "--jobs", "2", "--folder", str(folder)),
        *("--out", str(folder / "figures.json"), "--page", str(folder / "page"), *more),
    ]  # fmt: skip


def test_a_task_is_plain_text() -> None:
    task = records(Path("somewhere")).task(1)
    assert Task.from_json(task.as_json()) == task


@pytest.mark.moderate
def test_other_records_other_work_another_folder(tmp_path: Path) -> None:
    few, more = records(tmp_path), Records(population(6, 2), tmp_path, SAMPLES)
    named = {one.results for one in (few, more, records(tmp_path, keep=True), records(tmp_path, tracing=False))}
    assert len(named) == 4


@pytest.mark.long
@pytest.mark.timeout(900)
def test_its_judgements_are_those_of_its_records(tmp_path: Path) -> None:
    """Rows come from processes of their own, by way of JSON and Parquet; nothing of a judgement is lost on it."""
    campaign = records(tmp_path)
    rows = carried_out(campaign, 2, silent)
    direct = []
    for order in ORDERS:
        place = tmp_path / order.name
        said = place / "diagnosis.json"
        truth = json.loads((place / "truth.json").read_text())
        direct.append(judge(truth, json.loads(said.read_text()) if said.exists() else None))
    assert judgements(campaign, rows) == direct
    assert json.dumps(summarise(judgements(campaign, rows))) == json.dumps(summarise(direct))
    (file,) = campaign.results.glob("results/file=*/rows.parquet")
    table = pq.read_table(file).to_pydict()
    assert table["name"] == [order.name for order in ORDERS]
    assert table["verdict"] == [one.verdict for one in direct]
    assert table["outcome"] == ["traced", "refused"]  # the second is too short for its device
    assert table["reason"][0] is None
    assert "capture.arrow" in table["reason"][1]
    answered = (tmp_path / ORDERS[1].name / "traced.json").stat().st_mtime_ns
    again = carried_out(records(tmp_path, keep=True), 1, silent)  # another campaign of the same records
    assert [row["judgement"] for row in again] == [row["judgement"] for row in rows]
    assert (tmp_path / ORDERS[1].name / "traced.json").stat().st_mtime_ns == answered


@pytest.mark.long
@pytest.mark.timeout(900)
def test_killed_twice_it_comes_to_the_same(tmp_path: Path) -> None:
    """`kill -9` of the whole of it, among the first records and then among the rest."""
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    assert main(command(whole)) == 0
    for rows in (1, 3):
        with subprocess.Popen(
            [sys.executable, "-m", "evaluation.undeclared", *command(cut)],
            stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
        ) as campaign:  # fmt: skip
            until = time.monotonic() + WAIT_S
            while lines(cut) < rows:
                assert campaign.poll() is None
                assert time.monotonic() < until
                time.sleep(0.05)
            os.kill(campaign.pid, signal.SIGKILL)
        assert not (cut / "figures.json").exists()
    assert main(command(cut)) == 0
    (one,), (other,) = (list((folder / "campaigns").iterdir()) for folder in (whole, cut))
    assert one.name == other.name
    assert bytes_in(one) == bytes_in(other)
    assert (whole / "figures.json").read_bytes() == (cut / "figures.json").read_bytes()
    runs = [json.loads(line)["run"] for line in (other / "wall.jsonl").read_text().splitlines()]
    assert sorted(runs) == list(range(len(population(6, 2))))  # none twice


@pytest.mark.long
def test_a_cluster_comes_to_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two workers of a Dask scheduler, each its own process: records, rows and answers to the last byte those of one
    process here; the workers began elsewhere, so a folder that is given by a relative path is still the same one.
    """
    from distributed import Client  # here, so that no process that only collects this loads it

    orders = [*ORDERS, Order("clean", (), 1, draw=2), Order("double", ("drive_gain", "cubic_stiffness"), 2, draw=2)]
    alone = Records(orders, tmp_path / "alone", SAMPLES, rows_per_file=3)
    carried_out(alone, 1, silent)
    cluster = Cluster(tmp_path)
    cluster.start_scheduler()
    try:
        cluster.start_worker()
        cluster.start_worker()
        with Client(cluster.address, timeout=60.0, set_as_default=False) as client:
            client.wait_for_workers(2, timeout=60.0)
        monkeypatch.chdir(tmp_path)
        spread = Records(orders, Path("spread"), SAMPLES, rows_per_file=3)
        carried_out(spread, None, silent, scheduler=cluster.address)
    finally:
        cluster.end()
    assert alone.results.name == spread.results.name
    results = bytes_in(alone.results)
    assert len(results) >= 2
    assert bytes_in(spread.results) == results
    for order in orders:
        one, other = (folder / order.name / "capture.arrow" for folder in (alone.folder, spread.folder))
        assert one.read_bytes() == other.read_bytes(), order.name
    wall = [json.loads(line) for line in (spread.results / "wall.jsonl").read_text().splitlines()]
    assert sorted(one["run"] for one in wall) == list(range(len(orders)))
    assert len({one["pid"] for one in wall}) == 2


def lines(folder: Path) -> int:
    """Rows in the journal of the campaign below a folder."""
    return sum(len(journal.read_text().splitlines()) for journal in folder.glob("campaigns/*/journal.jsonl"))


@pytest.mark.slow
def test_a_record_of_another_draw_in_its_place_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    order = population(6, 2)[0]
    make(order, tmp_path, 500)
    with pytest.raises(InputError, match="of another draw or length"):
        make(order, tmp_path, 600)
    assert main(command(tmp_path)) == 2
    told = capsys.readouterr().err.splitlines()[-1]
    assert told.startswith(f"evaluation.undeclared: {tmp_path / order.name / 'truth.json'}: of another draw or length")
    assert "give another --folder" in told


@pytest.mark.slow
def test_no_scheduler_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("hil.sweeping.cluster._CONNECT_S", 0.5)
    assert main(command(tmp_path, "--scheduler", f"tcp://127.0.0.1:{free_port()}")) == 2
    assert "no scheduler answers there; start one with `dask scheduler`" in capsys.readouterr().err.splitlines()[-1]


def test_no_record_to_evaluate_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", *command(tmp_path)[1:]]) == 2
    assert "no record of this draw is there" in capsys.readouterr().err
