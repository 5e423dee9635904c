"""The routes of runs, jobs and bench files, asked of a real service over HTTP."""

import json
import shutil
import struct
import time
import urllib.parse
import xml.etree.ElementTree as Xml
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hil
from hil.records.atomic import sealed
from tests.service.folders import another
from tests.service.records import write
from tests.service.serving import Serving, serving

RUN = "20250101-000000-a"


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory, source: Path) -> Iterator[Serving]:
    """A service with a few runs."""
    place = tmp_path_factory.mktemp("bench")
    for day in range(1, 4):
        another(source, place / "runs", f"2025010{day}-000000-{'abc'[day - 1]}", records=True)
    shutil.copyfile(source / "report.html", place / "runs" / RUN / "report.html")
    (place / "secret.txt").write_text("secret")
    (place / "runs" / RUN / "link.txt").symlink_to(place / "secret.txt")
    with serving(place / "runs") as running:
        _until(lambda: running.ask("GET", "/api/runs").json()["total"] == 3)
        yield running


def _until(test: Any, seconds: float = 30.0) -> None:
    deadline = time.monotonic() + seconds
    while not test():
        assert time.monotonic() < deadline
        time.sleep(0.05)


@pytest.mark.moderate
def test_runs_are_listed_and_paged(bench: Serving) -> None:
    first = bench.ask("GET", "/api/runs", params={"limit": 2, "sort": "time"}).json()
    assert [row["id"] for row in first["runs"]] == [RUN, "20250102-000000-b"]
    rest = bench.ask("GET", "/api/runs", params={"limit": 2, "sort": "time", "after": first["next"]}).json()
    assert [row["id"] for row in rest["runs"]] == ["20250103-000000-c"]
    assert rest["next"] is None
    since = bench.ask("GET", "/api/runs", params={"since": "2025-01-02T12:00:00", "where": "angle_u_rad>0"}).json()
    assert [row["id"] for row in since["runs"]] == ["20250103-000000-c"]


@pytest.mark.moderate
def test_a_run_and_what_belongs_to_it(bench: Serving) -> None:
    run = bench.ask("GET", f"/api/runs/{RUN}").json()
    names = [file["name"] for file in run["files"]]
    assert "capture.arrow" in names
    assert "link.txt" not in names
    assert run["figures"]["kxx"]["unit"] == "1/s²"
    data = bench.ask("GET", f"/api/runs/{RUN}/files/capture.arrow")
    assert data.content == (bench.folder / RUN / "capture.arrow").read_bytes()
    assert data.headers["content-disposition"].startswith("attachment")
    assert bench.ask("GET", f"/api/runs/{RUN}/result").json()["run"] == RUN


def test_a_report_may_run_and_load_nothing(bench: Serving) -> None:
    answer = bench.ask("GET", f"/api/runs/{RUN}/report")
    assert answer.status_code == 200
    policy = answer.headers["content-security-policy"]
    assert policy.startswith("sandbox;")
    assert "script-src" not in policy
    assert "default-src 'none'" in policy
    assert bench.ask("GET", "/api/runs/20250102-000000-b/report").status_code == 404


def test_a_window_of_a_run_is_a_frame(bench: Serving) -> None:
    names = [one["name"] for one in bench.ask("GET", f"/api/runs/{RUN}/channels").json()]
    assert {"capture.vx_V", "estimates.angle_rad", "innovation.nu_x_V"} <= set(names)
    answer = bench.ask(
        "GET", f"/api/runs/{RUN}/series", params={"channels": "capture.vx_V,capture.vy_V", "from": 0.5, "to": 0.51}
    )
    magic, _, channels, buckets, begin, step, _ = struct.unpack_from("<4sIIIddQ", answer.content)
    assert (magic, channels) == (b"GYT1", 2)
    values = np.frombuffer(answer.content, "<f4", offset=40).reshape(2, buckets, 2)
    capture = hil.load(bench.folder / RUN).capture
    inside = (capture.t_s >= begin - 1e-9) & (capture.t_s < begin + buckets * step - 1e-9)
    np.testing.assert_allclose(values[0, :, 0], capture["vx_V"][inside], rtol=1e-6)


def test_tags_and_notes_stay(bench: Serving) -> None:
    answer = bench.ask("PATCH", f"/api/runs/{RUN}", json={"tags": ["keep", "keep", "ü"], "note": "seen <b>"})
    assert answer.status_code == 200
    assert (answer.json()["tags"], answer.json()["note"]) == (["keep", "ü"], "seen <b>")
    assert json.loads((bench.folder / RUN / "marks.json").read_text())["tags"] == ["keep", "ü"]
    assert [row["id"] for row in bench.ask("GET", "/api/runs", params={"tag": "ü"}).json()["runs"]] == [RUN]
    assert bench.ask("GET", "/api/tags").json() == {"keep": 1, "ü": 1}
    assert bench.ask("PATCH", f"/api/runs/{RUN}", json={"tags": ["x" * 1000]}).status_code == 422
    assert bench.ask("PATCH", f"/api/runs/{RUN}", json={"verdict": "good"}).status_code == 422
    bench.ask("PATCH", f"/api/runs/{RUN}", json={"tags": [], "note": ""})


def test_a_deleted_run_comes_back(bench: Serving) -> None:
    run = "20250103-000000-c"
    undo = bench.ask("DELETE", f"/api/runs/{run}").json()["undo"]
    assert bench.ask("GET", f"/api/runs/{run}").status_code == 404
    assert bench.ask("GET", "/api/runs", params={"deleted": True}).json()["total"] == 1
    assert bench.ask("POST", undo).json()["id"] == run
    assert bench.ask("GET", f"/api/runs/{run}").status_code == 200
    assert bench.ask("POST", undo).status_code == 404


def test_two_runs_and_a_device(bench: Serving) -> None:
    found = bench.ask("GET", "/api/compare", params={"a": RUN, "b": "20250102-000000-b"}).json()
    assert found["same_record"]
    assert bench.ask("GET", "/api/compare", params={"a": RUN, "b": "nobody"}).status_code == 404
    (device,) = bench.ask("GET", "/api/devices").json()
    assert device["runs"] == 3
    trend = bench.ask("GET", f"/api/devices/{device['serial']}/trend", params={"figure": "kxx"}).json()
    assert len(trend["points"]) == 3
    assert bench.ask("GET", f"/api/devices/{device['serial']}/trend", params={"figure": "no"}).status_code == 400
    assert bench.ask("GET", "/api/devices/nobody").status_code == 404


def test_verdicts_as_junit(bench: Serving) -> None:
    answer = bench.ask("GET", "/api/runs.junit.xml")
    assert answer.headers["content-type"].startswith("application/xml")
    assert Xml.fromstring(answer.text).get("tests") == "3"


HOSTILE = [
    "..", ".", "../secret.txt", "..%2f..%2fsecret.txt", "%2e%2e", "%2e%2e%2fsecret.txt", "....//", "/etc/passwd",
    "%2fetc%2fpasswd", "~", "~root", "\x00", "%00", ".service", ".trash", ".service/audit.jsonl", "' OR 1=1 --",
    "a" * 5000, "ü", "%ff%fe", "*", "CON", f"{RUN}/..", f"{RUN}%00", "-", "null", "{run}",
]  # fmt: skip


@pytest.mark.parametrize("hostile", HOSTILE)
def test_no_id_reaches_the_file_system(bench: Serving, hostile: str) -> None:
    raw = hostile if "%" in hostile else urllib.parse.quote(hostile, safe="/")
    before = sorted(path.name for path in bench.folder.iterdir())
    for method, path in (
        ("GET", f"/api/runs/{raw}"), ("GET", f"/api/runs/{raw}/report"), ("DELETE", f"/api/runs/{raw}"),
        ("POST", f"/api/runs/{raw}/restore"), ("GET", f"/api/runs/{RUN}/files/{raw}"), ("PATCH", f"/api/runs/{raw}"),
        ("GET", f"/api/runs/{raw}/series?channels={raw}"), ("GET", f"/api/runs/{RUN}/series?channels={raw}"),
        ("GET", f"/api/devices/{raw}"), ("GET", f"/api/jobs/{raw}"), ("DELETE", f"/api/jobs/{raw}"),
        ("GET", f"/api/benches/{raw}"),
    ):  # fmt: skip
        answer = bench.ask(method, path, json={} if method == "PATCH" else None)
        if answer.status_code < 400:  # a client makes a/.. into a before it sends it: what was asked then is harmless
            assert "secret" not in answer.text
        else:
            assert 400 <= answer.status_code < 500, (method, path, answer.text)
            assert "Traceback" not in answer.text
    assert sorted(path.name for path in bench.folder.iterdir()) == before


def test_bench_files_are_listed_and_given_what_a_trace_found(bench: Serving, tmp_path: Path) -> None:
    listed = {one["name"]: one for one in bench.ask("GET", "/api/benches").json()["benches"]}
    assert listed["s-slow"]["device"] == "S-slow"
    assert listed["s-slow"]["settings"]["amplitude"] == hil.load_bench("s-slow").device.amplitude_m
    assert "[device]" in bench.ask("GET", "/api/benches/s-slow").text
    assert bench.ask("POST", "/api/benches/s-slow/effects", json={"trace": RUN}).status_code == 400
    assert bench.ask("POST", "/api/benches/s-slow/effects", json={"trace": "nobody"}).status_code == 404
    assert bench.ask("POST", "/api/benches/s-slow/effects", json={"trace": RUN, "name": "../x"}).status_code == 422


@pytest.mark.long
def test_a_trace_by_a_job_and_its_effect_added(bench: Serving) -> None:
    """The circle without the board: what is missing is found, declared in a new bench file, and undone by a replay."""
    from hil.bench import examples
    from hil.running.request import RunRequest
    from hil.running.run import run

    declared = hil.load_bench("s-undeclared").with_(loop={"clock": "lockstep", "duration_s": 10.0, "settle_s": 2.0})
    link = f"inproc:{examples.find('scenario', 's-undeclared')}"
    folder = run(RunRequest(declared, link), bench.folder, report=False, progress=lambda _: None).folder
    assert folder is not None
    _until(lambda: bench.ask("GET", f"/api/runs/{folder.name}").status_code == 200)
    asked = bench.ask("POST", "/api/jobs", json={"kind": "trace", "run": folder.name, "bench": "s-undeclared"})
    assert asked.status_code == 201
    job = asked.json()["id"]
    assert bench.ask("DELETE", f"/api/runs/{folder.name}").status_code == 409  # a job works on it
    _until(lambda: bench.ask("GET", f"/api/jobs/{job}").json()["state"] not in ("queued", "running"), 240)
    row = bench.ask("GET", f"/api/jobs/{job}").json()
    assert (row["state"], row["result"]["verdict"]) == ("done", "explained")
    trace = row["result"]["run"]
    assert bench.ask("GET", f"/api/runs/{trace}/diagnosis").json()["verdict"] == "explained"
    assert [one["id"] for one in bench.ask("GET", f"/api/runs/{folder.name}").json()["traces"]] == [trace]
    added = bench.ask("POST", "/api/benches/s-undeclared/effects", json={"trace": trace})
    assert added.status_code == 201
    assert added.json()["name"] == "s-undeclared-better"
    assert "cubic_stiffness" in added.json()["effects"]
    again = bench.ask("POST", "/api/jobs", json={"kind": "replay", "run": folder.name, "bench": "s-undeclared-better"})
    _until(lambda: bench.ask("GET", f"/api/jobs/{again.json()['id']}").json()["state"] == "done", 120)
    better = bench.ask("GET", f"/api/jobs/{again.json()['id']}").json()["result"]["run"]
    found = bench.ask("GET", "/api/compare", params={"a": folder.name, "b": better}).json()
    (ratio,) = [one for one in found["figures"] if one["name"] == "residual_ratio"]
    assert ratio["better"] == "b"
    assert ratio["b"] < 1.1 < ratio["a"]


@pytest.mark.moderate
@pytest.mark.parametrize(
    ("parts", "twice"),
    [(("record", "record"), "record"), (("record", "map", "map"), "map"), (("map", "record", "record"), "record")],
)
def test_an_upload_of_two_files_of_one_kind_is_refused_whole(
    bench: Serving, parts: tuple[str, ...], twice: str
) -> None:
    files = [(part, (f"{number}.csv", "t_s,vx_V\n0,1\n1,2\n")) for number, part in enumerate(parts)]
    answer = bench.ask("POST", "/api/uploads", files=files)
    assert answer.status_code == 422
    assert answer.json() == {
        "error": f"more than one {twice} in the form", "remedy": "send each record in a request of its own"
    }  # fmt: skip
    assert not list((bench.folder / ".service" / "uploads").iterdir())


@pytest.mark.slow
def test_an_upload_is_bounded_and_imported(bench: Serving) -> None:
    lines = "\n".join(f"{0.001 * n:.4f},{n % 7},{n % 5},0.1,0.2" for n in range(500))
    files = {"record": ("../ride.csv", f"t_s,vx_V,vy_V,ux_mps2,uy_mps2\n{lines}\n")}
    sent = bench.ask("POST", "/api/uploads", files=files)
    assert sent.status_code == 201
    job = bench.ask("POST", "/api/jobs", json={"kind": "import", "upload": sent.json()["id"], "name": "ride"}).json()
    _until(lambda: bench.ask("GET", f"/api/jobs/{job['id']}").json()["state"] == "done", 90)
    run = bench.ask("GET", f"/api/jobs/{job['id']}").json()["result"]["run"]
    _until(lambda: bench.ask("GET", f"/api/runs/{run}").status_code == 200)
    assert bench.ask("GET", f"/api/runs/{run}").json()["state"] == "recorded"
    assert hil.load(bench.folder / run).capture["vx_V"][5] == 5.0
    assert not list((bench.folder / ".service" / "uploads").iterdir())  # it has been imported
    assert bench.ask("POST", "/api/uploads", files={"record": ("a.exe", "x")}).status_code == 400
    assert bench.ask("POST", "/api/uploads", files={"other": ("a.csv", "x")}).status_code == 400
    assert bench.ask("POST", "/api/uploads", content=b"junk").status_code == 400
    large = {"content-length": str(10**12), "content-type": "multipart/form-data; boundary=x"}
    with pytest.raises(Exception, match=r"(?s)."):
        bench.ask("POST", "/api/uploads", headers=large, content=b"x").raise_for_status()


@pytest.mark.long
def test_a_long_record_is_prepared_by_a_job(tmp_path: Path) -> None:
    with serving(tmp_path / "runs") as running:
        write(tmp_path / "runs" / "20250101-000000-long", np.arange(5_000_000), pyramid=False)
        path = "/api/runs/20250101-000000-long/series?channels=capture.vx_V"
        _until(lambda: running.ask("GET", path).status_code != 404)
        first = running.ask("GET", path)
        assert first.status_code == 202
        assert first.json()["job"]["kind"] == "pyramid"
        _until(lambda: running.ask("GET", path).status_code == 200, 60)
        assert running.ask("GET", path).content[:4] == b"GYT1"


@pytest.mark.moderate
def test_the_catalogue_is_made_anew_of_the_folders(bench: Serving) -> None:
    """A file that an editor changed in place is not seen until then."""
    place = bench.folder / RUN / "result.json"
    told = place.read_text()
    before = bench.ask("GET", f"/api/runs/{RUN}").json()["verdict"]
    try:
        with place.open("r+") as file:  # the folder itself stays as it was
            file.write(sealed(json.dumps({**json.loads(told), "verdict": "unsafe"})))
            file.truncate()
        assert bench.ask("GET", f"/api/runs/{RUN}").json()["verdict"] == before
        folders = sum(one.is_dir() and not one.name.startswith(".") for one in bench.folder.iterdir())
        assert bench.ask("POST", "/api/catalogue/rebuild").json() == {"runs": folders}
        assert bench.ask("GET", f"/api/runs/{RUN}").json()["verdict"] == "unsafe"
    finally:
        with place.open("r+") as file:
            file.write(told)
            file.truncate()
        bench.ask("POST", "/api/catalogue/rebuild")


@pytest.mark.moderate
def test_campaigns_are_listed_and_a_job_without_a_report_has_none(bench: Serving) -> None:
    assert "s-slow-noise" in bench.ask("GET", "/api/campaigns").json()["campaigns"]
    assert bench.ask("GET", "/api/jobs/20250101-000000-00000000/report").status_code == 404
    assert bench.ask("POST", "/api/jobs", json={"kind": "sweep", "campaign": "../x"}).status_code == 400
