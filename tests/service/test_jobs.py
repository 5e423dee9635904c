"""Jobs: what is asked for is done by the library in a process of its own, ends well, and is never lost from sight."""

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import hil
from hil.errors import InputError
from hil.service.jobs.asked import AskedImport, AskedReplay, AskedRun, AskedSweep, order_of
from hil.service.jobs.jobs import CRASHED, Jobs
from hil.service.jobs.uploads import TooLarge, Uploads
from hil.service.problems import Unknown

LIMIT_S = 250.0  # for figures and report of a run, on a busy machine


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    """A bench file beside the runs, of a run that is soon over."""
    from hil.bench.template import template, values_of

    (tmp_path / "runs").mkdir()
    made = hil.load_bench("s-slow").with_(
        loop={"settle_s": 0.5, "duration_s": 1.5, "clock": "lockstep", "name": "short"},
        link={"url": "inproc:s-slow.scenario.toml"},
    )
    path = tmp_path / "short.bench.toml"
    path.write_text(template(values_of(made), "A short run."))
    return path


class Watched:
    """Jobs of a folder, and all that was told of them."""

    def __init__(self, place: Path, **given: Any) -> None:
        self.runs = place / "runs"
        self.rows: list[dict[str, Any]] = []
        self.made: list[str] = []
        self.jobs = Jobs(
            place / "jobs", self.runs, told=lambda row: self.rows.append(dict(row)), made=self.made.append, **given
        )
        self.uploads = Uploads(place / "uploads")

    def ask(self, asked: Any) -> str:
        order = order_of(asked, self.runs, lambda run: self.runs / run, self.uploads)
        return str(self.jobs.add(order, asked.model_dump(exclude_none=True), by="tester")["id"])

    def until(self, job: str, *states: str) -> dict[str, Any]:
        deadline = time.monotonic() + LIMIT_S
        while (row := self.jobs.row(job))["state"] not in states:
            assert time.monotonic() < deadline, row
            time.sleep(0.02)
        return row


@pytest.fixture
def watched(bench: Path, tmp_path: Path) -> Iterator[Watched]:
    made = Watched(tmp_path)
    yield made
    made.jobs.close()


def ended(watched: Watched, asked: Any) -> dict[str, Any]:
    return watched.until(watched.ask(asked), "done", "failed", "cancelled")


@pytest.mark.long
def test_run_trace_and_replay_one_after_another(watched: Watched) -> None:
    row = ended(watched, AskedRun(kind="run", bench="short", note="from a job", score=True))
    assert (row["state"], row["error"], row["by"]) == ("done", None, "tester")
    folder = watched.runs / row["result"]["run"]
    result = hil.load(folder).result
    assert result.operator_note == "from a job"
    assert row["result"]["verdict"] == result.verdict
    assert row["result"]["angle_error_rms_rad"] == result.angle_error_rms_rad is not None
    assert watched.made[0] == folder.name
    stages = [one["stage"] for one in watched.rows if one["stage"]]
    assert "score" in stages
    assert len(set(stages)) > 2
    assert not list(folder.parent.parent.rglob("truth*"))
    again = ended(watched, AskedReplay(kind="replay", run=folder.name))
    assert (again["state"], again["error"]) == ("done", None)
    assert hil.load(watched.runs / again["result"]["run"]).result.samples == result.samples


@pytest.fixture
def campaign(bench: Path) -> str:
    """A campaign beside the runs: so many that it can be stopped on its way."""
    (bench.parent / "few.campaign.toml").write_text(
        'name = "few"\nscenario = "s-slow"\nbench = "s-slow"\nseeds = 40\n'
        '[fixed]\n"bench.loop.duration_s" = 0.6\n"bench.loop.settle_s" = 0.2\n'
    )
    return "few"


@pytest.mark.long
def test_a_campaign_tells_how_long_it_takes_is_cancelled_and_goes_on(watched: Watched, campaign: str) -> None:
    job = watched.ask(AskedSweep(kind="sweep", campaign=campaign, workers=1))
    deadline = time.monotonic() + LIMIT_S
    while not [row for row in watched.rows if row["stage"] == "runs" and row["left_s"]]:
        assert time.monotonic() < deadline, watched.rows[-1:]
        time.sleep(0.01)
    assert watched.jobs.row(job)["total"] == 40
    watched.jobs.cancel(job)
    row = watched.until(job, "cancelled", "failed", "done")
    assert row["state"] == "cancelled", row
    assert "runs are done and kept in" in row["error"]
    again = ended(watched, AskedSweep(kind="sweep", campaign=campaign))
    assert (again["state"], again["error"]) == ("done", None)
    assert again["result"]["campaign"] == "few"
    assert again["result"]["outcomes"] == {"ran": 40}
    assert 0 < again["result"]["made"] < 40
    assert (watched.runs / "few" / "report.html").is_file()


@pytest.mark.slow
def test_a_campaign_is_named_not_located(watched: Watched, campaign: str) -> None:
    for name in ("../few", "/etc/passwd", "nothing"):
        with pytest.raises(InputError, match="no campaign file of this bench"):
            watched.ask(AskedSweep(kind="sweep", campaign=name))
    (watched.runs.parent / f"{campaign}.campaign.toml").write_text("name = 3")
    row = ended(watched, AskedSweep(kind="sweep", campaign=campaign))
    assert row["state"] == "failed"
    assert "few.campaign.toml" in row["error"]


@pytest.mark.long
def test_a_run_that_is_cancelled_ends_well(watched: Watched) -> None:
    job = watched.ask(AskedRun(kind="run", bench="short", duration_s=3600, name="long"))
    deadline = time.monotonic() + LIMIT_S
    while not [row for row in watched.rows if row["result"] and (row["done"] or 0) > 4000 and row["left_s"]]:
        assert time.monotonic() < deadline, watched.rows[-1:]
        time.sleep(0.02)
    running = watched.jobs.row(job)
    assert running["left_s"] > 0
    assert (running["stage"], running["total"]) == ("run", 3600 * 4000)
    assert watched.jobs.using(running["result"]["run"]) == [job]
    watched.jobs.cancel(job)
    row = watched.until(job, "cancelled", "failed", "done")
    assert row["state"] == "cancelled"
    assert "SAFE was confirmed" in row["error"]
    run = hil.load(watched.runs / row["result"]["run"])
    assert run.verdict == "interrupted"
    assert run.result.complete
    assert watched.jobs.using(run.path.name) == []


@pytest.mark.moderate
def test_what_waits_can_be_cancelled_and_what_ended_forgotten(bench: Path, tmp_path: Path) -> None:
    watched = Watched(tmp_path, at_once=1)
    first = watched.ask(AskedRun(kind="run", bench="short", duration_s=3600))
    second = watched.ask(AskedRun(kind="run", bench="short"))
    assert watched.jobs.row(second)["state"] == "queued"
    assert watched.jobs.cancel(second)["state"] == "cancelled"
    watched.jobs.cancel(first)
    watched.until(first, "cancelled")
    watched.jobs.cancel(second)
    assert [row["id"] for row in watched.jobs.rows()] == [first]
    with pytest.raises(Unknown):
        watched.jobs.row(second)
    watched.jobs.close()


@pytest.mark.slow
def test_a_failure_is_one_line_and_leaves_no_run(watched: Watched) -> None:
    row = ended(watched, AskedRun(kind="run", bench="short", duration_s=0.1))
    assert row["state"] == "failed"
    assert "settle_s" in row["error"]
    assert "\n" not in row["error"]
    assert not list(watched.runs.iterdir())


def test_a_job_that_is_killed_says_so(watched: Watched) -> None:
    job = watched.ask(AskedRun(kind="run", bench="short", duration_s=3600))
    deadline = time.monotonic() + LIMIT_S
    while not (found := watched.jobs._jobs[job].child):
        assert time.monotonic() < deadline
        time.sleep(0.01)
    found.kill()
    row = watched.until(job, "failed")
    assert "killed by SIGKILL" in row["error"]


_SERVICE = """
import sys, time
from pathlib import Path
from hil.service.jobs.jobs import Jobs

def told(row):
    sys.stdout.write(f"{row['done'] or 0}\\n")
    sys.stdout.flush()

place = Path(sys.argv[1])
jobs = Jobs(place / "jobs", place / "runs", at_once=1, told=told)
do = {"kind": "run", "bench": sys.argv[2], "link": None, "duration_s": 3600}
jobs.add(do, {"kind": "run"}, by="x")
jobs.add(do, {"kind": "run"}, by="x")
time.sleep(1000)
"""


@pytest.mark.slow
def test_killed_with_its_service_a_job_ends_and_is_listed_as_interrupted(bench: Path, tmp_path: Path) -> None:
    service = subprocess.Popen([sys.executable, "-c", _SERVICE, str(tmp_path), str(bench)], stdout=subprocess.PIPE)
    assert service.stdout is not None
    with service, service.stdout:
        try:
            while int(service.stdout.readline()) < 4000:
                pass
        finally:
            service.send_signal(signal.SIGKILL)
    watched = Watched(tmp_path)
    first, second = sorted(row["id"] for row in watched.jobs.rows())
    row = watched.until(first, "failed")
    assert "the service ended" in row["error"] or row["error"] == CRASHED
    waiting = watched.jobs.row(second)
    assert (waiting["state"], waiting["error"]) == ("failed", CRASHED)
    (folder,) = watched.runs.iterdir()
    assert hil.load(folder).verdict == "interrupted"  # the run was ended well
    deadline = time.monotonic() + LIMIT_S
    while _processes_of(tmp_path / "jobs"):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    watched.jobs.close()
    later = Watched(tmp_path)  # it stays so
    assert [row["state"] for row in later.jobs.rows()] == ["failed", "failed"]
    later.jobs.close()


def _processes_of(place: Path) -> list[int]:
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if str(place).encode() in (process / "cmdline").read_bytes() and int(process.name) != os.getpid():
                found.append(int(process.name))
        except OSError:
            continue
    return found


@pytest.mark.long
def test_ending_the_service_ends_its_jobs_well(bench: Path, tmp_path: Path) -> None:
    watched = Watched(tmp_path)
    job = watched.ask(AskedRun(kind="run", bench="short", duration_s=3600))
    deadline = time.monotonic() + LIMIT_S
    while not [row for row in watched.rows if (row["done"] or 0) > 4000]:
        assert time.monotonic() < deadline
        time.sleep(0.02)
    watched.jobs.close()
    row = watched.jobs.row(job)
    assert row["state"] == "failed"
    assert "the service ended" in row["error"]
    assert hil.load(watched.runs / row["result"]["run"]).verdict == "interrupted"
    later = Watched(tmp_path)
    assert later.jobs.row(job) == row
    later.jobs.close()


@pytest.mark.slow
@pytest.mark.parametrize("torn", ["order.json", "outcome.json"])
def test_a_job_whose_files_are_damaged_stops_nobody(watched: Watched, tmp_path: Path, torn: str) -> None:
    row = ended(watched, AskedRun(kind="run", bench="short", duration_s=0.1))
    (tmp_path / "jobs" / row["id"] / torn).write_text('{"state": ')
    later = Watched(tmp_path)
    assert [one["state"] for one in later.jobs.rows()] == ([] if torn == "order.json" else ["failed"])
    later.jobs.close()


@pytest.mark.parametrize(
    "link", ["serial:/dev/ttyACM0", "udp:239.0.0.1:4242", "can:can0", "inproc:/etc/passwd", "pty:../x", "inproc:nobody"]
)
def test_a_job_runs_emulated_boards_only(watched: Watched, link: str) -> None:
    with pytest.raises(InputError, match=r"emulated boards only|no scenario file"):
        watched.ask(AskedRun(kind="run", bench="short", link=link))


def test_nor_by_the_link_of_a_bench_file(watched: Watched, bench: Path) -> None:
    text = bench.read_text().replace('"inproc:s-slow.scenario.toml"', '"serial:/dev/ttyACM0"')
    bench.with_name("real.bench.toml").write_text(text)
    with pytest.raises(InputError, match="no emulated board"):
        watched.ask(AskedRun(kind="run", bench="real"))


@pytest.mark.parametrize("name", ["../short", "/etc/passwd", "", ".", "short.bench.toml/../x", "s-slow\x00"])
def test_a_bench_is_one_that_is_listed(watched: Watched, name: str) -> None:
    with pytest.raises(InputError, match="no bench file"):
        watched.ask(AskedRun(kind="run", bench=name))


# uploads


async def _pieces(*pieces: bytes) -> Any:
    for piece in pieces:
        yield piece


def _upload(
    uploads: Uploads, name: str, record: bytes, given: bytes | None = None, map_name: str = "beam.map.toml"
) -> str:
    import asyncio

    receiving = uploads.begin(name)
    asyncio.run(receiving.record(_pieces(record)))
    if given is not None:
        asyncio.run(receiving.map(_pieces(given), map_name))
    return receiving.done().id


def _ride(rows: int = 3_000) -> bytes:
    lines = [f"{0.001 * n:.6f},{(n % 17) * 0.01:.4f},{(n % 13) * 0.02:.4f},0.5,-0.25" for n in range(rows)]
    return "\n".join(["t_s,vx_V,vy_V,ux_mps2,uy_mps2", *lines]).encode() + b"\n"


@pytest.mark.slow
def test_an_upload_with_its_own_map(watched: Watched) -> None:
    text = _ride().replace(b"t_s,vx_V,vy_V,ux_mps2,uy_mps2", b"time,a,b,c,d")
    given = b"""sampling_rate_Hz = 1000.0
hold = "zoh"
[columns]
vx = { column = "a", unit = "V" }
vy = { column = "b", unit = "V" }
"""
    upload = _upload(watched.uploads, "ride.csv", text, given)
    row = ended(watched, AskedImport(kind="import", upload=upload))
    assert (row["state"], row["error"]) == ("done", None)
    assert row["result"]["tick_rate_Hz"] == 1000.0


_MAP = b"""sampling_rate_Hz = 1000.0
hold = "zoh"
[columns]
vx = { column = "a", unit = "V" }
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("record", "given", "error"),
    [
        (b"b\n1\n2\n", _MAP, "My Ride.csv: no column 'a' for vx; "),
        (b"a\n1\nx\n", _MAP, "My Ride.csv:3: column a (vx): 'x' is not a number"),
        (b"a\n1\n2\n", _MAP.replace(b"hold", b"hodl"), "C:beam.map.toml: "),
        (b"a\n1\n2\n", b"[[[", "C:beam.map.toml: not TOML: "),
    ],
)
def test_errors_of_an_import_name_the_files_as_they_were_sent(
    watched: Watched, record: bytes, given: bytes, error: str
) -> None:
    upload = _upload(watched.uploads, "C:\\me/My Ride.csv", record, given, "~/C:beam.map.toml")
    row = ended(watched, AskedImport(kind="import", upload=upload))
    assert row["state"] == "failed"
    assert row["error"].startswith(error)
    assert upload not in row["error"]
    assert str(watched.runs) not in row["error"]


@pytest.mark.slow
def test_errors_of_a_job_name_files_of_the_bench_as_they_were_asked_for(watched: Watched) -> None:
    (watched.runs / "half.bench.toml").write_text("[device]\nname = 5\n")
    asked = AskedRun(kind="run", bench="half.bench.toml", link="inproc:s-slow")
    row = ended(watched, asked)
    assert row["error"].startswith("half.bench.toml: ")


@pytest.mark.long
def test_parquet_comes_back_as_it_was_exported(watched: Watched, source: Path, tmp_path: Path) -> None:
    hil.export(source, tmp_path / "out.parquet", what="capture")
    upload = _upload(watched.uploads, "out.parquet", (tmp_path / "out.parquet").read_bytes())
    row = ended(watched, AskedImport(kind="import", upload=upload))
    assert (row["state"], row["error"]) == ("done", None)
    ours, theirs = hil.load(watched.runs / row["result"]["run"]).capture, hil.load(source).capture
    for name in ("vx_V", "vy_V", "ux_mps2", "uy_mps2"):
        assert ours[name] == pytest.approx(theirs[name], abs=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("ride.csv", b"\x00\xff" * 5_000),
        ("ride.csv.gz", b"\x1f\x8b\x08\x00junk"),
        ("r.mat", b"MATLAB 5.0 MAT-file" + b"\0" * 500),
        ("r.parquet", b"PAR1" + b"\xff" * 500 + b"PAR1"),
    ],
)
def test_what_is_no_record_is_told_in_one_line(watched: Watched, name: str, data: bytes) -> None:
    row = ended(watched, AskedImport(kind="import", upload=_upload(watched.uploads, name, data)))
    assert row["state"] == "failed"
    assert "a fault of hil" not in row["error"]
    assert "\n" not in row["error"]
    assert not list(watched.runs.iterdir())


@pytest.mark.slow
@pytest.mark.parametrize(("bound", "words"), [("PROCESSOR_S", "more processor time"), ("MEMORY_BYTES", "memory")])
def test_an_import_cannot_take_all_memory_nor_all_the_time(
    watched: Watched, monkeypatch: pytest.MonkeyPatch, bound: str, words: str
) -> None:
    import gzip

    bomb = gzip.compress(b"t_s,vx_V\n" + b"".join(b"%d,0\n" % n for n in range(6_000_000)), 1)
    upload = _upload(watched.uploads, "bomb.csv.gz", bomb)
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    most = 1 if bound == "PROCESSOR_S" else pages * os.sysconf("SC_PAGESIZE") + (32 << 20)
    monkeypatch.setattr(f"hil.service.jobs.limits.{bound}", most)  # of this process, of which the job's is a fork
    row = ended(watched, AskedImport(kind="import", upload=upload))
    assert row["state"] == "failed"
    assert words in row["error"]
    assert not list(watched.runs.iterdir())


def test_uploads_are_bounded(tmp_path: Path) -> None:
    uploads = Uploads(tmp_path / "uploads", most_bytes=1_000)
    with pytest.raises(TooLarge):
        _upload(uploads, "a.csv", b"x" * 1_001)
    with pytest.raises(InputError, match="no record that is taken"):
        uploads.begin("a.exe")
    with pytest.raises(InputError, match="no record came"):
        _upload(uploads, "a.csv", b"")
    for upload in ("", "..", "../x", "0" * 24, "/etc"):
        with pytest.raises(InputError, match="no such upload"):
            uploads.of(upload)


def test_old_uploads_are_removed(tmp_path: Path) -> None:
    uploads = Uploads(tmp_path / "uploads")
    upload = _upload(uploads, "a.csv", b"x")
    os.utime(tmp_path / "uploads" / upload, (0, 0))
    uploads.tidy()
    assert list((tmp_path / "uploads").iterdir()) == []


@pytest.mark.slow
def test_a_pyramid_is_made_once(watched: Watched) -> None:
    import numpy as np

    from tests.service.records import write

    record = write(watched.runs / "20250101-000000-long", np.arange(1_100_000), pyramid=False)
    rows: list[dict[str, Any]] = []
    threads = [
        threading.Thread(target=lambda: rows.append(watched.jobs.pyramid(record.parent.name, record, by="x")))
        for _ in range(5)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len({row["id"] for row in rows}) == 1
    watched.until(rows[0]["id"], "done")
    assert (record.parent / "pyramid" / "capture-256.arrow").exists()
    assert (
        json.loads((tmp := watched.jobs._jobs[rows[0]["id"]].place / "outcome.json").read_text())["state"] == "done"
    ), tmp


def test_a_job_names_no_run_that_left_nothing(watched: Watched, bench: Path) -> None:
    bench.write_text(re.sub(r"(?m)^sample_rate_Hz = .*$", "sample_rate_Hz = 5000", bench.read_text()))
    row = ended(watched, AskedRun(kind="run", bench="short"))
    assert watched.made  # it had begun
    assert not list(watched.runs.iterdir())
    assert (row["state"], row["result"]) == ("failed", None)
