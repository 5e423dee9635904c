"""Every kind of bad file and value, over every verb that takes one: one line, exit code 2, no traceback.

Through the real command line, in this process; whole processes where a process of the bench's own is at work.
"""

import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from device_emulator.section import ScenarioError
from hil.bench import load_any_bench
from hil.bench.examples import find
from hil.cli import execute
from hil.errors import InputError
from hil.wire.links import open_link
from tests.cli.conftest import Hil
from tests.cli.test_errors import refused
from tests.records.synthetic_run import Options, write_run
from tests.running.gyro import scenario

EVIL = "a\x1b[31mred\x07\u202egnirts\x9b2J\nnext"
DEEP = 5000


def contents() -> Iterator[tuple[str, bytes]]:
    """Files that are none of ours."""
    yield "empty", b""
    yield "binary", bytes(range(256)) * 64
    yield "zeros", bytes(5000)
    yield "half a letter", "key = 'ä'".encode()[:-2]
    yield "deep lists", b"a = " + b"[" * DEEP + b"]" * DEEP
    yield "deep tables", b"[" + b".".join([b"a"] * DEEP) + b"]\nb = 1"
    yield "deep inline", b"a = " + b"{b=" * DEEP + b"1" + b"}" * DEEP
    yield "deep json", b"[" * 100_000
    yield "deep objects", b'{"a":' * 100_000
    yield "a long number", b"a = " + b"9" * 5000
    yield "control characters", b"\x1b]0;title\x07[device\x1b[2J]\n"
    yield "arrow magic", b"ARROW1\x00\x00" + b"\xff" * 64
    yield "arrow prefix", b"\xff\xff\xff\xff\xff\xff\xff\x7f" + bytes(100)
    yield "csv", b"t_s,vx_V\n0,1\n\x1b[31m,2\n"
    yield "json", b'{"version": 1, "run": "\\u001b[31m"}'


CONTENTS = dict(contents())
VERBS = {
    "bench": ["run", "FILE", "--link", "inproc:s-slow", "--clock", "lockstep"],
    "bench of a replay": ["replay", "capture.arrow", "--bench", "FILE"],
    "bench of a trace": ["trace", "capture.arrow", "--bench", "FILE"],
    "scenario": ["run", "s-slow", "--link", "inproc:FILE", "--clock", "lockstep"],
    "scenario on a pty": ["run", "s-slow", "--link", "pty:FILE"],
    "emulate": ["emulate", "FILE"],
    "replay": ["replay", "FILE", "--bench", "s-slow"],
    "trace": ["trace", "FILE", "--bench", "s-slow"],
    "export": ["export", "FILE", "-o", "out.csv"],
    "check": ["check", "FILE"],
    "repair": ["check", "FILE", "--repair"],
    "import": ["import", "FILE", "-o", "out.arrow"],
    "map": ["import", "ride.csv", "--map", "FILE", "-o", "out.arrow"],
    "campaign": ["sweep", "FILE", "--dry-run"],
    "truth": ["score", "run", "--truth", "FILE"],
    "compare": ["compare", "FILE", "--bench", "s-slow"],
    "truth of a comparison": ["compare", "capture.arrow", "--bench", "s-slow", "--truth", "FILE"],
    "trace of a comparison": ["compare", "capture.arrow", "--bench", "s-slow", "--diagnosis", "FILE"],
    "key": ["run", "s-slow", "--link", "udp:127.0.0.1:4299?key=FILE", "--arm"],
}
FINE = {("import", "csv")}


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bad")
    write_run(folder / "run", Options(seconds=1.0))
    (folder / "capture.arrow").write_bytes((folder / "run" / "capture.arrow").read_bytes())
    (folder / "ride.csv").write_text("t_s,vx_V\n0,0.1\n0.001,0.2\n0.002,0.1\n")
    return folder


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a run that can be scored, and its truth."""
    folder = tmp_path_factory.mktemp("whole")
    write_run(folder / "run", Options(seconds=1.0, settle_s=0.1)).rename(folder / "truth.arrow")
    return folder


def told(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, list[str]]:
    code = execute(list(arguments))
    return code, [line for line in capsys.readouterr().err.splitlines() if line.startswith("hil: ")]


def assert_one_plain_line(code: int, lines: list[str]) -> None:
    assert code == 2
    assert_plain(lines)


def assert_plain(lines: list[str]) -> None:
    (line,) = lines
    assert all(mark.isprintable() for mark in line), ascii(line)
    assert "Traceback" not in line
    assert len(line) < 1000


# A process each, two seconds: the reader of scenarios is given all of them below.
COSTLY = ("emulate", "scenario", "scenario on a pty")
OFTEN = ("deep lists", "binary", "empty", "control characters", "arrow prefix", "json")
TRIED = [
    pytest.param(verb, content, marks=() if content in OFTEN or verb == "bench" else pytest.mark.long)
    for verb in VERBS
    for content in (("deep lists", "binary", "empty") if verb in COSTLY else CONTENTS)
]


@pytest.mark.slow
@pytest.mark.parametrize(("verb", "content"), TRIED)
def test_a_file_that_is_none(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], verb: str, content: str
) -> None:
    monkeypatch.chdir(place)
    (place / "file.toml").write_bytes(CONTENTS[content])
    for made in ("out.csv", "out.arrow"):
        (place / made).unlink(missing_ok=True)
    arguments = [word.replace("FILE", "file.toml") for word in VERBS[verb]]
    assert_one_plain_line(*told(capsys, *arguments))


@pytest.mark.parametrize("content", CONTENTS)
def test_a_scenario_that_is_none(tmp_path: Path, content: str) -> None:
    (tmp_path / "file.toml").write_bytes(CONTENTS[content])
    with pytest.raises(ScenarioError) as refusal:
        open_link(f"inproc:{tmp_path / 'file.toml'}")
    assert_plain(str(refusal.value).splitlines())


@pytest.mark.slow
@pytest.mark.parametrize("name", ["result.json", "bench.toml", "capture.arrow", "estimates.arrow", "innovation.arrow"])
@pytest.mark.parametrize("content", CONTENTS)
def test_a_run_folder_with_a_file_that_is_none(
    whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, content: str
) -> None:
    shutil.copytree(whole, tmp_path, dirs_exist_ok=True)
    (tmp_path / "run" / name).write_bytes(CONTENTS[content])
    assert_one_plain_line(*told(capsys, "score", str(tmp_path / "run"), "--truth", str(tmp_path / "truth.arrow")))


@pytest.mark.slow
@pytest.mark.parametrize("verb", VERBS)
def test_what_is_no_file(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], verb: str
) -> None:
    monkeypatch.chdir(place)
    (place / "folder.toml").mkdir(exist_ok=True)
    for name in ("gone.toml", "folder.toml", EVIL, "x" * 300):
        assert_one_plain_line(*told(capsys, *(word.replace("FILE", name) for word in VERBS[verb])))


def bench_with(folder: Path, old: str, new: str) -> str:
    text = Path(find("bench", "s-slow")).read_text(encoding="utf-8")
    assert old in text
    path = folder / "changed.bench.toml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    return str(path)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("settle_s = ", 'settle_s = "\\u001b[31m" #'),
        ("[loop]", f"[loop]\nseed = {2**63}"),
        ("[loop]", f"[loop]\nseed = {10**400}"),
    ],
)
def test_values_out_of_this_world(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], old: str, new: str
) -> None:
    monkeypatch.chdir(tmp_path)
    bench = bench_with(tmp_path, old, new)
    assert_one_plain_line(*told(capsys, "run", bench, "--link", "inproc:s-slow", "--clock", "lockstep"))


def test_a_seed_that_is_too_large(capsys: pytest.CaptureFixture[str]) -> None:
    assert_one_plain_line(*told(capsys, "run", "s-slow", "--seed", str(2**63)))
    assert_one_plain_line(*told(capsys, "emulate", "s-slow", "--seed", str(2**63)))


@pytest.mark.slow
def test_a_folder_that_takes_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    place = "/proc/self/fdinfo"  # nobody can make a file there, root neither
    run = ["run", "s-slow", "--link", "inproc:s-slow", "--clock", "lockstep"]
    for taken in (f"{place}/runs", f"{Path(__file__)}/runs"):
        code, lines = told(capsys, *run, "--out", taken)
        assert_one_plain_line(code, lines)
        assert "--out" in lines[0]
    assert_one_plain_line(*told(capsys, *run, "--out", str(tmp_path), "--truth", f"{place}/truth.arrow"))
    write_run(tmp_path / "run", Options(seconds=1.0))
    assert_one_plain_line(*told(capsys, "export", str(tmp_path / "run"), "-o", f"{place}/out.csv"))
    assert_one_plain_line(*told(capsys, "init", "-o", f"{place}/my.bench.toml"))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("section", "keys"),
    [
        ("truth", {"position_m": [100.0, 0.0]}),
        ("truth", {"velocity_mps": [1e300, 0.0]}),
        ("truth", {"mass_kg": 1e-300}),
        ("truth", {"mass_kg": 1e300}),
        ("truth", {"temperature_K": 1e300}),
        ("board", {"sample_rate_Hz": 1e12}),
        ("board", {"sample_rate_Hz": 1e-12}),
        ("rate", {"kind": "constant", "rate_rad_s": 1e9}),
        ("rate", {"kind": "constant", "rate_rad_s": -1e300}),
    ],
)
def test_a_scenario_that_nobody_can_mean(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], section: str, keys: dict[str, object]
) -> None:
    scenario(tmp_path / "far.scenario.toml", **{section: keys})
    link = f"inproc:{tmp_path / 'far.scenario.toml'}"
    run = ["run", "s-slow", "--link", link, "--clock", "lockstep", "--out", str(tmp_path / "runs")]
    assert_one_plain_line(*told(capsys, *run))
    assert not list((tmp_path / "runs").glob("*"))


@pytest.mark.moderate
@pytest.mark.parametrize("name", ["a/b", "../a", "a\nb", "ä", "-a", "", "a b", "n" * 101])
def test_a_name_that_no_folder_has_is_refused_in_words(hil: Hil, tmp_path: Path, name: str) -> None:
    link = ("--link", "inproc:s-slow", "--clock", "lockstep")
    record = tmp_path / "record"
    write_run(record, Options(seconds=2.0))
    before = sorted(tmp_path.rglob("*"))
    for verb in (
        ("run", "s-slow", *link),
        ("replay", str(record), "--bench", "s-slow"),
        ("trace", str(record), "--bench", "s-slow"),
        ("demo",),
        ("demo", "--gain-mode"),
        ("record", "stim300:/dev/null"),
    ):
        if verb[0] in ("replay", "trace", "demo", "record") and not name:
            continue  # an empty one is none: the default
        line = refused(hil(*verb, f"--name={name}"))
        assert "name" in line
        assert "pattern" not in line
        assert "^" not in line
        assert line.endswith(("a letter or digit first", "has 100 at most")), line
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(("made", "kind"), [(Path.mkdir, "a directory"), (os.mkfifo, "a named pipe")])
def test_a_bench_that_is_no_file_is_told_as_what_it_is(
    hil: Hil, tmp_path: Path, made: Callable[[Path], None], kind: str
) -> None:
    made(tmp_path / "there")
    assert refused(hil("run", "there")).startswith(f"there: is {kind}; give a bench file")


def test_a_folder_called_as_an_example_does_not_hide_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s-slow").mkdir()
    assert find("bench", "s-slow").name == "s-slow.bench.toml"


def test_a_capture_needs_no_import(hil: Hil, tmp_path: Path) -> None:
    write_run(tmp_path / "run", Options(seconds=0.5))
    line = refused(hil("import", "run/capture.arrow", "-o", "out.arrow"))
    assert "is an Arrow file; a capture needs no import, give it to `hil trace`" in line


def test_of_many_keys_the_nearest_are_told(tmp_path: Path) -> None:
    bench = tmp_path / "sensor.bench.toml"
    bench.write_text(find("bench", "rate-table-crs03").read_text("utf-8") + "\n[limits]\nangle_rad = 1.0\n", "utf-8")
    with pytest.raises(InputError, match=r"\[limits\] angle_rad: unknown key; the nearest of \d+ known: ") as refusal:
        load_any_bench(bench)
    assert str(refusal.value).count("_rad") >= 3
