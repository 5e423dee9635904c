"""A campaign on a Dask cluster whose worker and then whose scheduler are killed: nothing lost, nothing twice."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

import hil
from hil.progress import Progress
from tests.campaigns.clusters import Cluster, free_port, wait_for
from tests.campaigns.conftest import bytes_in
from tests.campaigns.small import RUNS


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    made = Cluster(tmp_path)
    made.start_scheduler()
    yield made
    made.end()


@pytest.mark.long
@pytest.mark.parametrize("seen", [True, False], ids=["gone for a while", "back before the host looks"])
def test_killed_worker_and_scheduler_lose_and_double_nothing(
    cluster: Cluster, whole: dict[str, bytes], tmp_path: Path, seen: bool
) -> None:
    first, _ = cluster.start_worker(), cluster.start_worker()
    notes, killed = [], []

    def watch(progress: Progress) -> None:
        if progress.note:
            notes.append(progress.note)
        if progress.done >= 3 and not killed:
            first.kill()
            killed.append("worker")
        if progress.done >= 7 and killed == ["worker"]:
            assert cluster.scheduler is not None
            cluster.scheduler.kill()
            cluster.scheduler.wait()
            killed.append("scheduler")
            if not seen:  # the host is held here until the scheduler answers again
                start_again()
                wait_for(cluster)
        if seen and "is gone" in progress.note:
            start_again()

    def start_again() -> None:
        cluster.start_scheduler()
        cluster.start_worker()

    swept = hil.sweep(RUNS, out=tmp_path / "there", scheduler=cluster.address, progress=watch)
    assert killed == ["worker", "scheduler"]
    assert any("is gone; waiting for it" in note for note in notes)
    assert any("is back" in note for note in notes)
    runs = [json.loads(line)["run"] for line in (swept.path / "wall.jsonl").read_text().splitlines()]
    assert sorted(runs) == list(range(16))
    assert swept.table["run"].to_pylist() == list(range(16))
    assert set(swept.table["outcome"].to_pylist()) == {"ran"}
    assert bytes_in(swept.path) == whole


@pytest.mark.slow
def test_no_scheduler_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hil.sweeping.cluster._CONNECT_S", 0.5)
    address = f"tcp://127.0.0.1:{free_port()}"
    with pytest.raises(hil.InputError, match="no scheduler answers there; start one with `dask scheduler`"):
        hil.sweep(RUNS, out=tmp_path / "a", scheduler=address)
    with pytest.raises(hil.InputError, match="give it as tcp://HOST:8786"):
        hil.sweep(RUNS, out=tmp_path / "a", scheduler="nonsense://x:1")


@pytest.mark.parametrize("address", ["foo", "", ":8786", "tcp://", "tcp://:8786", "tcp://host", "nonsense://x"])
def test_what_is_no_address_is_told_before_anything_is_made(tmp_path: Path, address: str) -> None:
    with pytest.raises(hil.InputError, match="no address; give it as tcp://HOST:8786"):
        hil.sweep(RUNS, out=tmp_path / "a", scheduler=address)
    assert not any(tmp_path.iterdir())
