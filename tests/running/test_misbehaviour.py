"""The bench against a board that was written from docs/wire.md and docs/safety.md alone, as it misbehaves."""

import shutil
from pathlib import Path

import pytest

from tests.running.written_board.judging import broken, build, cases, run

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("cc") is None, reason="the board is compiled with the system's C compiler"),
]

FIRST = (
    "safe_ignored",
    "id_sense_scale_nan",
    "session_other",
    "none",
    "reg_differs_0007",
    "safe_confirmed_but_drives",
    "safe_obeyed_unanswered",
    "fault_at_tick",
    "mute_rows_mid_run",
)


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(tmp_path_factory.mktemp("board"))


@pytest.mark.beyond(2)
@pytest.mark.parametrize("name", dict.fromkeys([*FIRST, *cases()]))
def test_the_bench_does_what_the_pages_say(program: Path, tmp_path: Path, name: str) -> None:
    case = cases()[name]
    seen = run(program, name, case, tmp_path / "case")
    assert broken(case, seen) == [], seen.said
