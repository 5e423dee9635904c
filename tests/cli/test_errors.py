"""What a user gets wrong: one line that names place and remedy, exit code 2, nothing left behind."""

from pathlib import Path

import pytest

from hil.bench import examples
from hil.cli.app import app
from tests.cli.conftest import Hil

VERBS = [command.name for command in app.registered_commands]


def refused(answer: tuple[int, str, str]) -> str:
    """The one line of a refused command, without the program's name."""
    code, out, err = answer
    assert code == 2
    assert out == ""
    assert err.startswith("hil: ")
    assert err.count("\n") == 1
    return err.removeprefix("hil: ").rstrip("\n")


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_explains_itself_with_examples(hil: Hil, verb: str) -> None:
    code, out, _ = hil(verb, "--help")
    assert code == 0
    assert f"    hil {verb}" in out.partition("Examples:")[2]
    assert "--json" in out


def test_no_verb_shows_the_help(hil: Hil) -> None:
    code, out, _ = hil()
    assert code == 0
    assert all(f"\n  {verb} " in out for verb in VERBS)


def test_misspelt_verb_and_option(hil: Hil) -> None:
    assert "'runn'" in refused(hil("runn"))
    assert "--duration" in refused(hil("run", "s-slow", "--duraton", "3"))
    assert "BENCH" in refused(hil("run"))
    for arguments in (["run"], ["run", "s-slow", "--duraton", "3"], ["run", "s-slow", "--duration"]):
        assert refused(hil(*arguments)).endswith("(see hil run --help)")
    assert refused(hil("runn")).endswith("(see hil --help)")


def test_a_word_that_is_none_of_those_known_is_told_with_them(hil: Hil) -> None:
    line = refused(hil("import", "ride.csv", "--hold", "banana"))
    assert line == (
        "Invalid value for '--hold': 'banana' is not one of 'zoh', 'foh', 'bandlimited'. (see hil import --help)"
    )


def test_unknown_example(hil: Hil) -> None:
    assert refused(hil("run", "s-slo")) == (
        "s-slo: no such bench file, and no example of that name; did you mean s-slow?"
    )


def test_bad_bench_file_names_file_section_and_key(hil: Hil, tmp_path: Path) -> None:
    text = examples.find("bench", "s-slow").read_text(encoding="utf-8")
    (tmp_path / "odd.bench.toml").write_text(text.replace("memory_s", "memmory_s"), encoding="utf-8")
    assert refused(hil("run", "odd.bench.toml")) == (
        "odd.bench.toml: [observer] memmory_s: unknown key; did you mean memory_s?"
    )


def test_options_are_checked_like_the_file(hil: Hil) -> None:
    line = refused(hil("run", "s-slow", "--duration", "2"))
    assert line.endswith(
        "with the options given: [loop] settle_s: 8 s leaves nothing to score of duration_s = 2 s; run for longer, or "
        "lower it in a bench file of your own (hil init --like)"
    )


def test_real_link_is_not_armed_without_consent(hil: Hil, tmp_path: Path) -> None:
    line = refused(hil("run", "s-slow", "--link", "serial:/dev/absent"))
    assert line == "serial:/dev/absent: arming a board needs --arm (--dry-run looks without arming)"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("link", ["foo:bar", "", "serial:"])
@pytest.mark.parametrize(
    "verb", [["run", "s-slow"], ["run", "s-slow", "--arm"], ["doctor"], ["init", "--from-board"]], ids=" ".join
)
def test_a_link_of_no_kind_is_told_before_anything_else(hil: Hil, tmp_path: Path, verb: list[str], link: str) -> None:
    line = refused(hil(*verb, "--link", link))
    assert line.startswith(f"link {link!r}: unknown kind of link; known are serial:…, can:…, udp:…, inproc:…, pty:…")
    assert list(tmp_path.iterdir()) == []


def test_truth_is_for_boards_started_here(hil: Hil) -> None:
    line = refused(hil("run", "s-slow", "--link", "serial:/dev/absent", "--arm", "--truth", "t.arrow"))
    assert line == "--truth: serial:/dev/absent is not started here; give it to its hil emulate"


def test_scenario_of_a_link_has_to_exist(hil: Hil) -> None:
    assert "s-fast: no such scenario file" in refused(hil("run", "s-slow", "--link", "pty:s-fast"))
    assert "s-fast: no such scenario file" in refused(hil("emulate", "s-fast"))


def refused_by_board(answer: tuple[int, str, str]) -> str:
    """The same of an emulated board, however long it took to start: while it is waited for, that is told."""
    code, out, err = answer
    *before, last = err.splitlines(keepends=True)
    assert all(line == "board\n" or "waiting for the emulated board" in line for line in before)
    return refused((code, out, last))


@pytest.fixture(params=[None, 0.0], ids=["as it starts", "slowly"])
def start_up(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """A board that starts as it does, and one that takes longer than usual."""
    if request.param is not None:
        monkeypatch.setattr("hil.boards.emulation._USUAL_S", request.param)
        monkeypatch.setattr("hil.boards.emulation._TOLD_S", 0.05)


@pytest.mark.slow
@pytest.mark.usefixtures("start_up")
def test_bad_scenario_is_told_by_the_emulator(hil: Hil, tmp_path: Path) -> None:
    text = examples.find("scenario", "s-slow").read_text(encoding="utf-8")
    (tmp_path / "odd.scenario.toml").write_text(text.replace("mass_kg", "mas_kg"), encoding="utf-8")
    line = refused_by_board(hil("emulate", "odd.scenario.toml"))
    assert line == "emulated board: odd.scenario.toml: [truth] mas_kg: unknown key; did you mean mass_kg?"


@pytest.mark.slow
@pytest.mark.usefixtures("start_up")
def test_unwritable_truth_is_told_by_the_emulator(hil: Hil) -> None:
    assert "absent/t.arrow" in refused_by_board(hil("emulate", "s-slow", "--truth", "absent/t.arrow"))


def test_a_folder_of_runs_that_is_not_there(hil: Hil) -> None:
    assert refused(hil("ls", "nope")) == (
        "nope: no such folder; runs are kept in runs/ where hil is called: go there, or name their folder"
    )


def test_what_is_no_record_at_all(hil: Hil, tmp_path: Path) -> None:
    (tmp_path / "junk.txt").write_text("junk", encoding="utf-8")
    assert refused(hil("check", "junk.txt")).startswith("junk.txt: no record: not an Arrow stream")


def test_a_parquet_file_by_its_name_only(hil: Hil, tmp_path: Path) -> None:
    (tmp_path / "fake.parquet").write_text("hello\n1\n", encoding="utf-8")
    line = refused(hil("import", "fake.parquet"))
    assert line == "fake.parquet: no Parquet file, whatever its name says; export it anew, or name it as what it is"


def test_a_place_that_takes_no_file_is_told_with_the_remedy(hil: Hil, tmp_path: Path) -> None:
    (tmp_path / "ride.csv").write_text("t_s,vx_V,ux_V\n0,0,0\n1,0,0\n", encoding="utf-8")
    line = refused(hil("import", "ride.csv", "-o", "/proc/a.arrow"))
    assert line == "/proc/a.arrow: no such file or directory; give a place that can be used"


@pytest.mark.parametrize(
    ("mark", "said"),
    [
        ("comparison.json", "no run folder but a comparison; look at seen/report.html"),
        ("campaign.json", "no run folder but a campaign; look at seen"),
    ],
)
def test_a_folder_of_another_kind_is_told_as_such(hil: Hil, tmp_path: Path, mark: str, said: str) -> None:
    (tmp_path / "seen").mkdir()
    (tmp_path / "seen" / mark).write_text("{}", encoding="utf-8")
    if mark == "comparison.json":
        (tmp_path / "seen" / "report.html").write_text("", encoding="utf-8")
    assert refused(hil("show", "seen")) == f"seen: {said}"


def test_a_trace_is_no_run_to_score(hil: Hil, tmp_path: Path) -> None:
    (tmp_path / "seen").mkdir()
    (tmp_path / "seen" / "diagnosis.json").write_text("{}", encoding="utf-8")
    line = refused(hil("score", "seen", "--truth", "truth.arrow"))
    assert line == "seen: no run folder but a trace; hil show seen shows it"


def test_init_needs_both_or_neither(hil: Hil, tmp_path: Path) -> None:
    expected = "--from-board and --link belong together; give both or neither"
    assert refused(hil("init", "--from-board")) == expected
    assert refused(hil("init", "--link", "serial:/dev/absent")) == expected
    assert list(tmp_path.iterdir()) == []


def test_what_is_read_is_not_written_over(hil: Hil, tmp_path: Path) -> None:
    text = "t_s,vx_V,ux_V\n0,0,0\n1,0,0\n"
    (tmp_path / "ride.csv").write_text(text, encoding="utf-8")
    (tmp_path / "same.csv").symlink_to("ride.csv")
    for name in ("ride.csv", "same.csv"):
        assert (
            refused(hil("import", "ride.csv", "-o", name, "--replace")) == f"{name}: is what is read; give another name"
        )
    assert (tmp_path / "ride.csv").read_text(encoding="utf-8") == text
    assert hil("import", "ride.csv", "-o", "capture.arrow")[0] == 0
    before = (tmp_path / "capture.arrow").read_bytes()
    line = refused(hil("export", "capture.arrow", "-o", "capture.arrow", "--to", "csv", "--replace"))
    assert line == "capture.arrow: is what is read; give another name"
    assert (tmp_path / "capture.arrow").read_bytes() == before
    assert hil("import", "ride.csv", "-o", "capture.arrow", "--replace")[0] == 0  # a capture that is no run's


@pytest.mark.parametrize(
    "command",
    [
        ["export", "runs/ride", "--to", "csv", "-o"],
        ["import", "ride.csv", "-o"],
        ["ls", "--junit"],
        ["init", "-o"],
        ["run", "s-slow", "--link", "inproc:s-slow", "--truth"],
    ],
    ids=lambda command: command[0],
)
def test_a_run_is_not_written_over(hil: Hil, tmp_path: Path, command: list[str]) -> None:
    (tmp_path / "ride.csv").write_text("t_s,vx_V,ux_V\n0,0,0\n1,0,0\n", encoding="utf-8")
    folder = tmp_path / "runs" / "ride"
    folder.mkdir(parents=True)
    for name in ("result.json", "capture.arrow", "notes.csv"):
        (folder / name).write_text("mine", encoding="utf-8")
        if name != "notes.csv":
            line = refused(hil(*command, f"runs/ride/{name}", "--replace"))
            assert line.endswith(
                f"runs/ride/{name}: is part of a run, ride, and is not written over; give another name"
            )
            assert (folder / name).read_text(encoding="utf-8") == "mine"
    code, _, err = hil("init", "-o", "runs/ride/notes.csv", "--replace")
    assert code == 0, err  # what is no part of it


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["-o", "a.xls"], "a.xls: its name ends with no format; known are csv, parquet, mat, mcap, or give --to"),
        (["-o", "a"], "a: its name ends with no format; known are csv, parquet, mat, mcap, or give --to"),
        (["-o", "a.csv", "--to", "mat"], "--to mat: a.csv is named as csv; name it a.mat, or leave out --to"),
    ],
)
def test_an_export_is_what_its_name_says(hil: Hil, tmp_path: Path, options: list[str], said: str) -> None:
    assert refused(hil("export", "ride.arrow", *options)) == said
    assert not any(tmp_path.iterdir())


def test_nothing_is_overwritten(hil: Hil, tmp_path: Path) -> None:
    (tmp_path / "ride.csv").write_text("t_s,vx_V,ux_V\n0,0,0\n1,0,0\n", encoding="utf-8")
    for name in ("my.bench.toml", "ride.arrow"):
        (tmp_path / name).write_text("mine", encoding="utf-8")
    expected = "exists already; give another name, or --replace"
    assert refused(hil("init")) == f"my.bench.toml: {expected}"
    assert refused(hil("import", "ride.csv")) == f"ride.arrow: {expected}"
    assert (tmp_path / "my.bench.toml").read_text(encoding="utf-8") == "mine"


@pytest.mark.moderate
def test_what_is_asked_for_is_overwritten_but_never_a_folder(hil: Hil, tmp_path: Path) -> None:
    (tmp_path / "ride.csv").write_text("t_s,vx_V,ux_V\n0,0,0\n1,0,0\n", encoding="utf-8")
    for name in ("my.bench.toml", "ride.arrow"):
        (tmp_path / name).write_text("old", encoding="utf-8")
    assert hil("init", "--replace")[0] == 0
    assert hil("import", "ride.csv", "--replace")[0] == 0
    for name in ("my.bench.toml", "ride.arrow"):
        assert (tmp_path / name).read_bytes() != b"old"
    (tmp_path / "ride-folder").mkdir()
    line = refused(hil("import", "ride.csv", "--out", "ride-folder", "--replace"))
    assert line == "ride-folder: exists already; give another name"
    (tmp_path / "bad.csv").write_text("t_s,vx_V,ux_V\n0,0,0\n1,nan,0\n", encoding="utf-8")
    before = (tmp_path / "ride.arrow").read_bytes()
    refused(hil("import", "bad.csv", "--out", "ride.arrow", "--replace"))
    assert (tmp_path / "ride.arrow").read_bytes() == before


def test_an_option_that_has_another_name_now_is_refused_with_it(hil: Hil) -> None:
    for old, new in (("--force", "--missing-force"), ("--no-force", "--no-missing-force")):
        assert refused(hil("trace", "runs/a", old)) == f"{old}: is called {new} now (see hil trace --help)"
