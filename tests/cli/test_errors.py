"""What a user gets wrong: one line that names place and remedy, exit code 2, nothing left behind."""

from pathlib import Path

import pytest

from hil import cli, examples
from hil.cli.app import app
from tests.cli.conftest import Hil

REFERENCE = Path(__file__).parents[2] / "docs" / "reference" / "cli.md"
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
    assert f"`hil {verb}" in REFERENCE.read_text(encoding="utf-8")


def test_no_verb_shows_the_help(hil: Hil) -> None:
    code, out, _ = hil()
    assert code == 0
    assert all(f"\n  {verb} " in out for verb in VERBS)


def test_misspelt_verb_and_option(hil: Hil) -> None:
    assert "'runn'" in refused(hil("runn"))
    assert "--duration" in refused(hil("run", "s-slow", "--duraton", "3"))
    assert "BENCH" in refused(hil("run"))


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
        "lower it"
    )


def test_real_link_is_not_armed_without_consent(hil: Hil, tmp_path: Path) -> None:
    line = refused(hil("run", "s-slow", "--link", "serial:/dev/absent"))
    assert line == "serial:/dev/absent: arming a board needs --arm (--dry-run looks without arming)"
    assert list(tmp_path.iterdir()) == []


def test_truth_is_for_boards_started_here(hil: Hil) -> None:
    line = refused(hil("run", "s-slow", "--link", "serial:/dev/absent", "--arm", "--truth", "t.arrow"))
    assert line == "--truth: serial:/dev/absent is not started here; give it to its hil emulate"


def test_scenario_of_a_link_has_to_exist(hil: Hil) -> None:
    assert "s-fast: no such scenario file" in refused(hil("run", "s-slow", "--link", "pty:s-fast"))
    assert "s-fast: no such scenario file" in refused(hil("emulate", "s-fast"))


@pytest.mark.slow
def test_bad_scenario_is_told_by_the_emulator(hil: Hil, tmp_path: Path) -> None:
    text = examples.find("scenario", "s-slow").read_text(encoding="utf-8")
    (tmp_path / "odd.scenario.toml").write_text(text.replace("mass_kg", "mas_kg"), encoding="utf-8")
    line = refused(hil("emulate", "odd.scenario.toml"))
    assert line == "emulated board: odd.scenario.toml: [truth] mas_kg: unknown key; did you mean mass_kg?"


@pytest.mark.slow
def test_unwritable_truth_is_told_by_the_emulator(hil: Hil) -> None:
    assert "absent/t.arrow" in refused(hil("emulate", "s-slow", "--truth", "absent/t.arrow"))


def test_init_needs_both_or_neither(hil: Hil, tmp_path: Path) -> None:
    expected = "--from-board and --link belong together; give both or neither"
    assert refused(hil("init", "--from-board")) == expected
    assert refused(hil("init", "--link", "serial:/dev/absent")) == expected
    assert list(tmp_path.iterdir()) == []


def test_nothing_is_overwritten(hil: Hil, tmp_path: Path) -> None:
    (tmp_path / "ride.csv").write_text("t_s,vx_V,ux_V\n0,0,0\n1,0,0\n", encoding="utf-8")
    for name in ("my.bench.toml", "ride.arrow"):
        (tmp_path / name).write_text("mine", encoding="utf-8")
    expected = "exists already; give another name, or --replace"
    assert refused(hil("init")) == f"my.bench.toml: {expected}"
    assert refused(hil("import", "ride.csv")) == f"ride.arrow: {expected}"
    assert (tmp_path / "my.bench.toml").read_text(encoding="utf-8") == "mine"


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("t_s,vx_V,ux_V\n0,0,0\n1,0\n", "ride.csv:3"),
        ("t_s,vx_V,ux_V\n0,0,0\n0,0,0\n", "ride.csv:3: column t_s"),
        ("t_s,vx_V,ux_V\n0,0,0\n1,nan,0\n", "ride.csv:3: column vx_V"),
        ("t_s,vx_V,ux\n0,0,0\n1,0,0\n", "ride.csv:1"),
    ],
)
def test_bad_records_are_refused_whole(hil: Hil, tmp_path: Path, text: str, place: str) -> None:
    (tmp_path / "ride.csv").write_text(text, encoding="utf-8")
    assert refused(hil("import", "ride.csv")).startswith(place)
    assert [path.name for path in tmp_path.iterdir()] == ["ride.csv"]


def test_our_own_faults_are_not_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> Path:
        raise ZeroDivisionError

    monkeypatch.setattr(examples, "find", broken)
    with pytest.raises(ZeroDivisionError):
        cli.execute(["run", "s-slow"])


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
