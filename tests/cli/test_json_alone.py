"""`--json` of every verb: one JSON document alone on standard output, whatever else is told goes to standard error."""

import json
from pathlib import Path

import pytest

from hil.cli.app import app
from tests.cli.conftest import Hil, Start, finished

VERBS = {command.name for command in app.registered_commands}
CSV = "t_s,vx_V,vy_V,ux_mps2,uy_mps2\n" + "".join(f"{k / 4000},{k % 7 / 100},0,0,0\n" for k in range(200))
GOOD = {
    "generate": [["short.bench.toml", "--out", "c"]],
    "run": [
        ["short.bench.toml", "--link", "inproc:s-slow", "--out", "others"],
        ["short.bench.toml", "--link", "inproc:s-slow", "--dry-run"],
        ["short.bench.toml", "--link", "inproc:s-slow", "--open-loop", "--out", "others"],
    ],
    "characterise": [["last", "--truth", "truth.arrow", "--no-report", "--out", "others"]],
    "score": [["last", "--truth", "truth.arrow"]],
    "replay": [["last", "--bench", "short.bench.toml"]],
    "trace": [["last", "--bench", "short.bench.toml", "--no-report"]],
    "compare": [["last", "--bench", "short.bench.toml", "--truth", "truth.arrow"]],
    "ls": [[], ["elsewhere"]],
    "show": [["last"]],
    "check": [["last"], ["truth.arrow"]],
    "diff": [["last", "last"]],
    "import": [["ride.csv"]],
    "export": [["last", "--to", "csv"], ["last", "--what", "angle", "--to", "parquet"], ["last", "--to", "mat"]],
    "init": [["-o", "mine.bench.toml"], ["--resonance", "15000", "--q", "5000", "-o", "other.bench.toml"]],
    "sweep": [["s-slow-noise", "--dry-run"]],
    "key": [["gyro.key"]],
    "doctor": [[]],
}
"""What leaves an answer by itself, in a folder with a run, its truth, and a table of text."""

SERVING = {
    "emulate": (["s-slow"], "ready"),
    "serve": (["--port", "0"], "url"),
}
"""What goes on until it is told to stop: its first line is the document."""

ELSEWHERE = {"demo", "record", "top", "identify"}
"""Of these tests/cli/test_processes.py, tests/sensors, tests/service and tests/cli/test_identify.py speak: a demo takes
a minute, the others need a sensor, a service, a board that rests."""

ABSENT = {
    "generate": ["absent", "--out", "c"],
    "demo": ["--duration", "-1"],
    "run": ["absent.bench.toml"],
    "emulate": ["absent"],
    "record": ["stim300:/dev/absent"],
    "doctor": ["--link", "banana:0"],
    "init": ["--like", "absent"],
    "replay": ["absent", "--bench", "s-slow"],
    "trace": ["absent", "--bench", "s-slow"],
    "characterise": ["absent"],
    "identify": ["--record", "absent"],
    "score": ["absent", "--truth", "absent.arrow"],
    "compare": ["absent", "--bench", "s-slow"],
    "sweep": ["absent"],
    "ls": ["ride.csv"],
    "show": ["absent"],
    "diff": ["absent", "absent"],
    "check": ["absent.arrow"],
    "import": ["absent.csv"],
    "export": ["absent"],
    "key": ["absent/gyro.key"],
    "serve": ["--listen", "not-an-address", "--port", "0"],
    "top": ["http://127.0.0.1:9", "--once"],
}


def test_every_verb_is_here() -> None:
    assert VERBS == GOOD.keys() | SERVING.keys() | ELSEWHERE == ABSENT.keys()


@pytest.mark.slow
@pytest.mark.parametrize(("verb", "words"), [(verb, words) for verb, lines in GOOD.items() for words in lines])
def test_a_good_request_answers_with_one_document(
    hil: Hil, recorded: Path, tmp_path: Path, verb: str, words: list[str]
) -> None:
    (tmp_path / "ride.csv").write_text(CSV)
    (tmp_path / "elsewhere").mkdir()
    code, out, err = hil(verb, *words, "--json")
    assert code in (0, 1), err
    json.loads(out)  # more than one, or a line beside it, is "Extra data"
    assert "Traceback" not in err


@pytest.mark.slow
@pytest.mark.parametrize("verb", SERVING)
def test_what_serves_says_one_document_and_nothing_more(start: Start, verb: str) -> None:
    words, key = SERVING[verb]
    process = start(verb, *words, "--json")
    assert process.stdout is not None
    first = json.loads(process.stdout.readline())
    assert key in first
    process.terminate()
    _, rest, _ = finished(process)
    assert rest == ""


@pytest.mark.parametrize("verb", ABSENT)
def test_a_bad_request_is_one_document_there_and_one_line_elsewhere(hil: Hil, tmp_path: Path, verb: str) -> None:
    (tmp_path / "ride.csv").write_text(CSV)
    code, out, err = hil(verb, *ABSENT[verb], "--json")
    said = json.loads(out)
    assert (code, said["exit_code"], said.keys()) == (2, 2, {"error", "remedy", "exit_code"})
    *before, last = err.splitlines()
    assert last.startswith("hil: ")
    assert not [line for line in before if not line.startswith("the page will draw no curves")]  # a clone has no uPlot
