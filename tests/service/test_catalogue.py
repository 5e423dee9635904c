"""The catalogue says what the folders say, finds and keeps it, and loses nothing that people said."""

import json
import os
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import threading
import time
import xml.etree.ElementTree as Xml
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

import hil
from hil.errors import InputError
from hil.records.atomic import is_occupied, occupied, sealed, write_sealed
from hil.service.catalogue import queries
from hil.service.catalogue.catalogue import Catalogue, Conflict
from hil.service.catalogue.entry import id_of
from hil.service.catalogue.keeping import compare
from hil.service.catalogue.schema import MIGRATIONS
from hil.service.problems import Unknown
from tests.forked import hil_says
from tests.service.folders import another


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    """A folder for runs, with the service's own in it."""
    (tmp_path / "runs" / ".service").mkdir(parents=True)
    return tmp_path / "runs"


@pytest.fixture
def catalogue(runs: Path) -> Iterator[Catalogue]:
    """Its catalogue."""
    made = Catalogue(runs, runs / ".service")
    yield made
    made.close()


def rows(catalogue: Catalogue, **asked: Any) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = queries.listed(catalogue, queries.Page(**asked))["runs"]
    return found


def ids(catalogue: Catalogue, **asked: Any) -> list[str]:
    return [row["id"] for row in rows(catalogue, **asked)]


def test_a_run_is_listed_with_what_its_result_says(source: Path, runs: Path, catalogue: Catalogue) -> None:
    folder = Path(shutil.copytree(source, runs / source.name))
    assert catalogue.look().changed == 1
    (row,) = rows(catalogue)
    result = hil.load(folder).result
    assert row["id"] == row["folder"] == folder.name
    assert (row["kind"], row["verdict"], row["seconds"]) == ("run", result.verdict, result.seconds)
    assert (row["device"], row["bench"], row["name"]) == ("S-slow", "s-slow", "real")
    assert row["serial"] == result.serial_number
    assert row["figures"]["angle_rad"] == result.angle.rad
    assert row["figures"]["angle_u_rad"] == result.angle_u_rad
    assert row["state"] == "done"
    whole = queries.one(catalogue, row["id"])["figures"]
    low, high = result.parameters["kxx"].ci95
    assert whole["kxx"] == {
        "value": result.parameters["kxx"].value, "unit": "1/s²", "u": pytest.approx((high - low) / 2), "better": None,
    }  # fmt: skip
    assert whole["answered_fraction"]["value"] == 1.0
    stamped = time.strftime("%Y-%m-%dT%H:%M:%S", time.strptime(folder.name[:15], "%Y%m%d-%H%M%S"))
    assert row["time"].startswith(stamped)


def test_what_changes_in_the_folders_is_taken_over(source: Path, runs: Path, catalogue: Catalogue) -> None:
    first = another(source, runs, "20250101-000000-first")
    another(source, runs, "20250102-000000-second")
    assert catalogue.look().changed == 2
    _age(runs)
    catalogue.look()
    assert catalogue.look() == (0, 0, ())  # nothing is read that is as it was
    told = json.loads((first / "result.json").read_text()) | {"verdict": "failed"}
    (first / "new.json").write_text(sealed(json.dumps(told)))
    (first / "new.json").replace(first / "result.json")
    assert catalogue.look().ids == (first.name,)
    assert rows(catalogue, verdict="failed")[0]["id"] == first.name
    shutil.rmtree(first)
    assert catalogue.look().gone == 1
    assert ids(catalogue) == ["20250102-000000-second"]


def test_a_quick_look_sees_new_runs_and_the_newest(source: Path, runs: Path, catalogue: Catalogue) -> None:
    another(source, runs, "20250101-000000-first")
    catalogue.look()
    another(source, runs, "20250102-000000-second")
    assert catalogue.look(whole=False).ids[0] == "20250102-000000-second"


def test_a_quick_look_sees_the_record_that_comes_long_after_its_folder(
    source: Path, runs: Path, catalogue: Catalogue
) -> None:
    another(source, runs, "20250101-000000-first")
    late = runs / "20250102-000000-late"
    late.mkdir()
    os.utime(runs, (1.7e9, 1.7e9))
    for whole in (True, False, False):
        catalogue.look(whole=whole)
        assert ids(catalogue) == ["20250101-000000-first"]
    shutil.copyfile(source / "capture.arrow", late / "capture.arrow")
    assert catalogue.look(whole=False).ids[0] == late.name
    assert catalogue.look_at("20250103-000000-nobody") is None


def test_a_quick_look_costs_little_while_nothing_changes(
    source: Path, runs: Path, catalogue: Catalogue, monkeypatch: pytest.MonkeyPatch
) -> None:
    another(source, runs, "20250101-000000-first")
    _age(runs)
    os.utime(runs, (1.7e9, 1.7e9))
    os.utime(runs / ".trash", (1.7e9, 1.7e9))
    catalogue.look()
    monkeypatch.setattr(os, "scandir", lambda _: pytest.fail("the folders were gone through again"))
    assert catalogue.look(whole=False) == (0, 0, ())


@pytest.mark.moderate
def test_rebuilt_from_the_folders_it_is_the_same(source: Path, runs: Path, catalogue: Catalogue) -> None:
    for day in range(1, 8):
        another(source, runs, f"202501{day:02d}-000000-run", {"verdict": "good" if day % 2 else "failed"})
    catalogue.look()
    catalogue.mark("20250103-000000-run", tags=["after rework", "µ"], note="the third one")
    catalogue.delete("20250105-000000-run")
    before = {deleted: rows(catalogue, deleted=deleted) for deleted in (False, True)}
    assert len(before[False]) == 6
    catalogue.rebuild()
    assert {deleted: rows(catalogue, deleted=deleted) for deleted in (False, True)} == before
    catalogue.close()
    shutil.rmtree(runs / ".service")
    (runs / ".service").mkdir()
    anew = Catalogue(runs, runs / ".service")
    anew.look()
    assert {deleted: rows(anew, deleted=deleted) for deleted in (False, True)} == before
    (third,) = [row for row in before[False] if row["id"] == "20250103-000000-run"]
    assert (third["tags"], third["note"]) == (["after rework", "µ"], "the third one")
    anew.close()


@pytest.mark.parametrize("damage", ["cut", "noise", "newer"])
def test_a_database_that_cannot_be_used_is_made_anew(source: Path, runs: Path, damage: str) -> None:
    another(source, runs, "20250101-000000-first")
    first = Catalogue(runs, runs / ".service")
    first.look()
    first.close()
    path = runs / ".service" / "catalogue.sqlite"
    if damage == "newer":
        with sqlite3.connect(path) as database:
            database.execute(f"PRAGMA user_version = {len(MIGRATIONS) + 1}")
        database.close()
    else:
        path.write_bytes(path.read_bytes()[:5_000] if damage == "cut" else random.Random(1).randbytes(9_000))
    anew = Catalogue(runs, runs / ".service")
    anew.look()
    assert ids(anew) == ["20250101-000000-first"]
    anew.close()


def test_an_older_database_is_brought_up_to_date(source: Path, runs: Path) -> None:
    path = runs / ".service" / "catalogue.sqlite"
    database = sqlite3.connect(path)
    database.executescript(MIGRATIONS[0] + "PRAGMA user_version = 1;")
    database.execute(
        "INSERT INTO runs (id, trashed, folder, seen, kind, time, name, state) "
        "VALUES ('gone', 0, 'gone', '1-1', 'run', 0, 'gone', 'done')"
    )
    database.commit()
    database.close()
    another(source, runs, "20250101-000000-first")
    made = Catalogue(runs, runs / ".service")
    assert made.database.execute("PRAGMA user_version").fetchone()[0] == len(MIGRATIONS)
    assert made.look().gone == 1
    assert ids(made) == ["20250101-000000-first"]
    made.close()


@pytest.mark.long
def test_killed_in_the_middle_of_a_look_it_goes_on(source: Path, runs: Path) -> None:
    for number in range(250):
        another(source, runs, f"20250101-{number:06d}-run")
    script = (
        "import sys; from pathlib import Path; from hil.service.catalogue.catalogue import Catalogue;"
        "made = Catalogue(Path(sys.argv[1]), Path(sys.argv[1]) / '.service'); print('begun', flush=True); made.look();"
        "print('done', flush=True)"
    )
    seen = []
    while True:
        child = subprocess.Popen([sys.executable, "-c", script, str(runs)], stdout=subprocess.PIPE)
        assert child.stdout is not None
        with child, child.stdout:
            assert child.stdout.readline() == b"begun\n"
            time.sleep(0.25)
            child.send_signal(signal.SIGKILL)
            ended = b"done" in child.stdout.read()
        made = Catalogue(runs, runs / ".service")
        seen.append(queries.listed(made, queries.Page())["total"])
        whole = made.database.execute("SELECT count(DISTINCT key) FROM figures").fetchone()[0]
        assert whole == seen[-1]  # no run without its figures
        made.close()
        if ended or len(seen) > 40:
            break
    assert seen == sorted(seen)
    made = Catalogue(runs, runs / ".service")
    made.look()
    assert queries.listed(made, queries.Page())["total"] == 250
    made.close()


@pytest.mark.slow
def test_a_run_that_was_killed_is_listed_as_interrupted(runs: Path, catalogue: Catalogue) -> None:
    script = (
        "import sys, hil; bench = hil.load_bench('s-slow').with_(loop={'settle_s': 0.5});"
        "hil.run(bench, link='inproc:s-slow', clock='lockstep', duration_s=3600, name='long', out=sys.argv[1])"
    )
    child = subprocess.Popen([sys.executable, "-c", script, str(runs)], start_new_session=True)
    try:
        deadline = time.monotonic() + 60
        while not (found := [p for p in runs.glob("*-long/capture.arrow") if p.stat().st_size > 50_000]):
            assert time.monotonic() < deadline
            time.sleep(0.05)
        catalogue.look()
        assert [row["state"] for row in rows(catalogue)] == ["running"]
        with pytest.raises(Conflict, match="worked on"):
            catalogue.delete(found[0].parent.name)
    finally:
        os.killpg(child.pid, signal.SIGKILL)
        child.wait()
    deadline = time.monotonic() + 30
    while is_occupied(found[0].parent):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    catalogue.look(whole=False)
    (row,) = rows(catalogue)
    assert (row["state"], row["interrupted"], row["verdict"]) == ("interrupted", True, None)
    assert row["serial"]  # by the header of what was recorded


def test_nobody_holds_a_folder_that_a_run_has_left(source: Path, tmp_path: Path) -> None:
    assert not is_occupied(source)
    with occupied(tmp_path):
        assert is_occupied(tmp_path)
    assert not is_occupied(tmp_path)
    assert not is_occupied(tmp_path / "nowhere")


def test_what_cannot_be_read_is_listed_and_says_why(source: Path, runs: Path, catalogue: Catalogue) -> None:
    bad = another(source, runs, "20250101-000000-bad")
    (bad / "result.json").write_text('{"run": 7')
    toml = another(source, runs, "20250102-000000-toml")
    (toml / "bench.toml").write_bytes(b"\xff\xfe[[[")
    marks = another(source, runs, "20250103-000000-marks")
    (marks / "marks.json").write_text("[]")
    catalogue.look()
    found = {row["id"]: row for row in rows(catalogue)}
    assert found["20250101-000000-bad"]["state"] == "unreadable"
    assert "result.json" in found["20250101-000000-bad"]["unreadable"]
    assert "not TOML" in found["20250102-000000-toml"]["unreadable"]
    assert "marks.json" in found["20250103-000000-marks"]["unreadable"]
    with pytest.raises(InputError, match=r"marks\.json"):
        catalogue.mark("20250103-000000-marks", tags=["lost?"])
    assert (marks / "marks.json").read_text() == "[]"


@pytest.mark.parametrize(
    "name", ["..hidden", " ", "a b", "ü-µ", "%2e%2e", "a;rm -rf", "'; DROP TABLE runs; --", "x" * 250]
)
def test_folders_with_odd_names_have_plain_ids(source: Path, runs: Path, catalogue: Catalogue, name: str) -> None:
    another(source, runs, name)
    catalogue.look()
    if name.startswith("."):
        assert ids(catalogue) == []
        return
    (row,) = rows(catalogue)
    assert row["id"] == id_of(name)
    assert set(row["id"]) <= set("~abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-")
    assert catalogue.path_of(row["id"]) == runs / name
    catalogue.delete(row["id"])
    catalogue.restore(row["id"])
    assert (runs / name / "result.json").exists()


def test_a_link_to_elsewhere_is_no_run(source: Path, runs: Path, catalogue: Catalogue) -> None:
    (runs / "20250101-000000-link").symlink_to(source)
    catalogue.look()
    assert ids(catalogue) == []


@pytest.fixture
def many(source: Path, runs: Path, catalogue: Catalogue) -> Catalogue:
    """Forty runs with figures of their own, over two devices."""
    drawn = random.Random(7)
    for number in range(40):
        error = None if number % 10 == 3 else drawn.choice([0.001, 0.002, drawn.uniform(0.0, 1.0)])
        told = {
            "verdict": ["good", "failed", "interrupted"][number % 3],
            "angle_error_rms_rad": error,
            "serial_number": f"{number % 2:016x}",
            "operator_note": "Nach dem Umbau" if number == 8 else None,
        }
        another(source, runs, f"20250101-{number:06d}-run", told)
    catalogue.look()
    catalogue.mark("20250101-000004-run", tags=["keep"])
    return catalogue


@pytest.mark.moderate
def test_filters_are_exact(many: Catalogue) -> None:
    every = rows(many, limit=1000)
    assert len(every) == 40

    def check(test: Any, **asked: Any) -> None:
        wanted = {row["id"] for row in every if test(row)}
        assert wanted
        assert set(ids(many, limit=1000, **asked)) == wanted
        assert queries.listed(many, queries.Page(limit=1, **asked))["total"] == len(wanted)

    check(lambda row: row["verdict"] == "failed", verdict="failed")
    check(lambda row: row["serial"] == f"{1:016x}", serial=f"{1:016x}")
    check(lambda row: row["id"].endswith("000004-run"), tag="keep")
    check(lambda row: row["note"], q="UMBAU nach")
    check(lambda row: row["interrupted"], state="interrupted")
    check(lambda row: row["figures"].get("angle_error_rms_rad", 9) < 0.01, where=["angle_error_rms_rad<0.01"])
    check(
        lambda row: 0.1 <= row["figures"].get("angle_error_rms_rad", 9) <= 0.9 and row["verdict"] == "good",
        where=["angle_error_rms_rad>=0.1", "angle_error_rms_rad <= 9e-1"],
        verdict="good",
    )


@pytest.mark.moderate
@pytest.mark.parametrize(
    "sort", ["-time", "time", "verdict", "-verdict", "-angle_error_rms_rad", "angle_error_rms_rad"]
)
def test_pages_together_are_the_list(many: Catalogue, sort: str) -> None:
    every = rows(many, limit=1000, sort=sort)
    pages, after = [], None
    while True:
        found = queries.listed(many, queries.Page(limit=7, sort=sort, after=after))
        pages += found["runs"]
        if (after := found["next"]) is None:
            break
    assert [row["id"] for row in pages] == [row["id"] for row in every]
    name = sort.removeprefix("-")
    keys = [row["figures"][name] if name.startswith("angle") else row[name] for row in every]
    assert keys == sorted(keys, reverse=sort.startswith("-"))
    assert len(every) == (36 if name.startswith("angle") else 40)


@pytest.mark.moderate
def test_pages_over_columns_that_are_empty_lose_none(source: Path, runs: Path, catalogue: Catalogue) -> None:
    for number in range(12):
        another(source, runs, f"20250101-{number:06d}-run", {"verdict": None if number % 2 else "good"})
    catalogue.look()
    for sort in ("verdict", "-verdict"):
        seen, after = [], None
        while True:
            found = queries.listed(catalogue, queries.Page(limit=5, sort=sort, after=after))
            seen += [row["id"] for row in found["runs"]]
            if (after := found["next"]) is None:
                break
        assert len(seen) == len(set(seen)) == 12


@pytest.mark.moderate
@pytest.mark.parametrize(
    "asked",
    [{"sort": "nothing"}, {"sort": "time; DROP TABLE runs"}, {"where": ["a<b"]}, {"where": ["angle_rad<nan"]},
     {"where": ["foo<1"]}, {"where": ["1=1"]}, {"after": "AAAA"}, {"after": "é"}, {"after": "W10"}, {"limit": 0},
     {"limit": 10**6}],
)  # fmt: skip
def test_what_is_no_question_is_refused(many: Catalogue, asked: dict[str, Any]) -> None:
    with pytest.raises((InputError, ValidationError)):
        queries.listed(many, queries.Page(**asked))


@pytest.mark.moderate
@pytest.mark.parametrize("asked", [{"where": ["angle_u_rd<1"]}, {"sort": "angle_u_rd"}])
def test_an_unknown_figure_is_refused_with_those_near_it(many: Catalogue, asked: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=r"'angle_u_rd' is no .*; did you mean angle_u_rad"):
        queries.listed(many, queries.Page(**asked))


@pytest.mark.moderate
def test_a_cursor_is_good_for_its_own_order_only(many: Catalogue) -> None:
    after = queries.listed(many, queries.Page(limit=5))["next"]
    with pytest.raises(InputError, match="cursor"):
        queries.listed(many, queries.Page(limit=5, sort="time", after=after))


@pytest.mark.moderate
def test_deleted_runs_come_back_as_they_were(many: Catalogue, runs: Path) -> None:
    run = "20250101-000004-run"
    before = queries.one(many, run)
    inside = sorted(path.name for path in (runs / run).iterdir())
    many.delete(run)
    assert run not in ids(many, limit=1000)
    assert ids(many, deleted=True) == [run]
    assert not (runs / run).exists()
    with pytest.raises(Unknown):
        many.path_of(run)
    many.restore(run)
    assert queries.one(many, run) == before
    assert sorted(path.name for path in (runs / run).iterdir()) == inside
    with pytest.raises(Unknown):
        many.restore(run)


@pytest.mark.moderate
def test_a_deleted_run_does_not_replace_one_that_took_its_place(source: Path, many: Catalogue, runs: Path) -> None:
    run = "20250101-000004-run"
    many.delete(run)
    another(source, runs, run, {"operator_note": "the new one"})
    many.look()
    with pytest.raises(Conflict, match="another run"):
        many.restore(run)
    assert queries.one(many, run)["note"] == "the new one"


@pytest.mark.moderate
def test_the_trash_is_emptied_for_good(many: Catalogue, runs: Path) -> None:
    many.delete("20250101-000004-run")
    assert many.empty_trash() == 1
    assert ids(many, deleted=True) == []
    assert list((runs / ".trash").iterdir()) == []


@pytest.mark.moderate
def test_devices_and_the_trend_of_a_figure(many: Catalogue) -> None:
    found = {one["serial"]: one for one in queries.devices(many)}
    assert {serial: one["runs"] for serial, one in found.items()} == {f"{n:016x}": 20 for n in (0, 1)}
    serial = f"{1:016x}"
    trend = queries.trend(many, serial, "angle_error_rms_rad")
    wanted = [
        (row["id"], row["figures"]["angle_error_rms_rad"])
        for row in rows(many, serial=serial, sort="time", limit=1000)
        if "angle_error_rms_rad" in row["figures"]
    ]
    assert [(point["run"], point["value"]) for point in trend["points"]] == wanted
    assert (trend["unit"], trend["better"]) == ("rad", "less")
    assert queries.trend(many, serial, "kxx")["points"][0]["u"] > 0
    with pytest.raises(Unknown):
        queries.trend(many, "nobody", "kxx")
    with pytest.raises(InputError, match="no run"):
        queries.trend(many, serial, "nothing")
    assert "kxx" in [one["name"] for one in queries.device(many, serial)["figures"]]


@pytest.mark.moderate
def test_two_runs_side_by_side(source: Path, runs: Path, catalogue: Catalogue) -> None:
    told = json.loads((source / "result.json").read_text())
    better = {"angle_error_rms_rad": 0.001, "rate_error_rms_rad_s": 0.5}
    worse = {"angle_error_rms_rad": 0.004, "rate_error_rms_rad_s": 0.5}
    first = another(source, runs, "20250101-000000-a", better, records=True)
    second = another(source, runs, "20250102-000000-b", worse, records=True)
    text = (second / "bench.toml").read_text()
    write_sealed(second / "bench.toml", text.replace("watchdog_s = 0.02", "watchdog_s = 0.03"))
    catalogue.look()
    found = compare(catalogue, first.name, second.name)
    figures = {one["name"]: one for one in found["figures"]}
    error = figures["angle_error_rms_rad"]
    assert (error["a"], error["b"], error["better"]) == (0.001, 0.004, "a")
    assert error["difference"] == pytest.approx(0.003)
    assert figures["rate_error_rms_rad_s"]["better"] is None
    kxx = figures["kxx"]
    assert (kxx["difference"], kxx["apart"], kxx["better"]) == (0.0, False, None)
    low, high = told["parameters"]["kxx"]["ci95"]
    assert kxx["uncertainty"] == pytest.approx(high - low)  # of one record: the sum
    assert found["same_record"]
    assert "capture.vx_V" in found["channels"]
    assert found["bench"] == [{"key": "[link] watchdog_s", "a": 0.02, "b": 0.03}]
    capture = second / "capture.arrow"
    with capture.open("r+b") as file:
        file.truncate(capture.stat().st_size - 3_000)
    assert not compare(catalogue, first.name, second.name)["same_record"]


@pytest.mark.moderate
def test_compared_as_the_library_compares(source: Path, runs: Path, catalogue: Catalogue) -> None:
    told = json.loads((source / "result.json").read_text())
    angle = told["angle"] | {"rad": 1.5 * told["angle"]["rad"]}
    other = {"angle": angle, "innovation_rms": 0.5 * told["innovation_rms"]}
    first = Path(shutil.copytree(source, runs / "20250101-000000-a"))
    second = another(source, runs, "20250102-000000-b", other, records=True)
    (second / "capture.arrow").unlink()  # so that it is no longer one record
    catalogue.look()
    ours = {one["name"]: one for one in compare(catalogue, first.name, second.name)["figures"]}
    theirs = {one["name"]: one for one in hil.diff(first, second).as_json()["figures"]}
    for name, other in (("kxx", "kxx"), ("angle_rad", "angle at the end"), ("innovation_rms", "innovation, rms")):
        for key in ("a", "b", "difference", "uncertainty", "apart"):
            assert ours[name][key] == theirs[other][key], (name, key)


@pytest.mark.slow
def test_verdicts_as_junit(source: Path, runs: Path, tmp_path: Path) -> None:
    another(source, runs, "20250101-000000-good", {"verdict": "good"})
    another(source, runs, "20250102-000000-bad", {"verdict": "failed", "reasons": ['a <b> & "c" \x07']})
    another(source, runs, "20250103-000000-cut", {"verdict": "interrupted"})
    (another(source, runs, "20250104-000000-torn") / "result.json").write_text("{")
    target = tmp_path / "verdicts.xml"
    assert hil_says("ls", str(runs), "--junit", str(target)).returncode == 0
    suite = Xml.parse(target).getroot().find("testsuite")
    assert suite is not None
    assert (suite.get("tests"), suite.get("failures"), suite.get("errors")) == ("4", "1", "2")
    cases = {case.get("name"): case for case in suite}
    assert len(cases["20250101-000000-good"]) == 0
    failure = cases["20250102-000000-bad"].find("failure")
    assert failure is not None
    assert 'a <b> & "c" \\x07' in (failure.get("message") or "")
    assert cases["20250103-000000-cut"].find("error") is not None
    assert cases["20250104-000000-torn"].find("error") is not None
    assert cases["20250101-000000-good"].get("classname") == "S-slow"


def test_whoever_ends_the_service_closes_it(runs: Path) -> None:
    made: list[Catalogue] = []
    opener = threading.Thread(target=lambda: made.append(Catalogue(runs, runs / ".service")))
    opener.start()
    opener.join()
    made[0].look()
    made[0].close()


def _age(runs: Path) -> None:
    """Make what is there older than what may still be changing."""
    for folder in runs.iterdir():
        if not folder.name.startswith("."):
            os.utime(folder, (1.7e9, 1.7e9))
