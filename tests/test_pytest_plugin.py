"""The pytest plugin: light where nobody asks for a board, the same tests on every link, skips that say why."""

import re
import subprocess
import sys
import tomllib
from importlib.metadata import entry_points
from pathlib import Path

import pytest

from hil.boards.emulation import emulator
from tests.running import gyro

pytest_plugins = ["pytester"]

ROOT = Path(__file__).parent.parent
INSTALLED = any(entry.name == "gyrohil" for entry in entry_points(group="pytest11"))
PLUGIN = () if INSTALLED else ("-p", "hil.pytest_plugin")


def run(pytester: pytest.Pytester, text: str, *options: str) -> pytest.RunResult:
    """The test file `text` run by a pytest of its own."""
    pytester.makepyfile(text)
    return pytester.runpytest_subprocess(*PLUGIN, "-rs", *options)


@pytest.mark.slow
def test_an_unrelated_project_pays_for_nothing() -> None:
    heavy = ["numba", "numpy", "scipy", "sympy", "pyarrow", "pydantic", "typer", "serial", "can", "hil.wire"]
    said = subprocess.run(
        [sys.executable, "-c", f"import hil.pytest_plugin, sys; print([m for m in {heavy} if m in sys.modules])"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert said.stdout == "[]\n"


def test_it_is_declared_where_pytest_looks() -> None:
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["entry-points"]["pytest11"]
    assert declared == {"gyrohil": "hil.pytest_plugin"}


@pytest.mark.long
def test_options_keys_and_markers_are_explained(pytester: pytest.Pytester) -> None:
    told = pytester.runpytest_subprocess(*PLUGIN, "--help").stdout.str()
    for name in ("--hil-bench", "--hil-link", "--hil-clock", "--hil-arm", "hil_bench (string)", "hil_link (string)"):
        assert name in told
    told = pytester.runpytest_subprocess(*PLUGIN, "--markers").stdout.str()
    assert "@pytest.mark.hil_clock(name)" in told
    assert "@pytest.mark.hil_emulated" in told


@pytest.mark.long
def test_without_a_bench_file_the_remedy_is_named(pytester: pytest.Pytester) -> None:
    result = run(pytester, "def test(bench): pass")
    result.assert_outcomes(errors=1)
    assert "give --hil-bench FILE, or hil_bench in pytest's ini file" in result.stdout.str()
    result = run(pytester, "def test(bench): pass", "--hil-bench", "s-slwo")
    assert "did you mean s-slow?" in result.stdout.str()
    assert "Traceback" not in result.stdout.str()


@pytest.mark.long
def test_a_board_in_this_process(pytester: pytest.Pytester) -> None:
    pytester.makeini("[pytest]\nhil_bench = s-slow\nhil_link = inproc:s-slow\n")
    result = run(
        pytester,
        """
        import pytest
        from hil.wire.messages import State

        def test_conversation(board, bench):
            assert board.identity.tick_rate_Hz == bench.device.sample_rate_Hz
            assert board.arm().state == State.ARMED
            assert board.safe().state == State.SAFE
            assert board.arm().state == State.ARMED

        @pytest.mark.parametrize("_", range(2))
        def test_each_test_gets_it_fresh(board, _):
            default = board.read("WATCHDOG_TICKS")
            assert default != 99
            assert board.write("WATCHDOG_TICKS", 99) == 99
            assert board.emulated

        @pytest.mark.hil_clock("paced")
        def test_of_wall_time(board):
            raise AssertionError

        def test_that_finds_out_on_its_way(board):
            board.require_clock("real")

        def test_that_fails(board):
            assert board.identity.axes == 3
        """,
    )
    result.assert_outcomes(passed=3, skipped=2, failed=1)
    assert "this board does not keep the clock 'paced'" in result.stdout.str()


@pytest.mark.slow
def test_a_board_not_started_here_is_armed_by_consent_only(pytester: pytest.Pytester, tmp_path: Path) -> None:
    text = """
        import pytest

        def test_looking_is_free(board):
            assert board.identity.axes == 2

        def test_arming(board):
            board.use_clock("paced")
            board.arm()

        @pytest.mark.hil_emulated
        def test_with_truth(board):
            raise AssertionError
        """
    with emulator(gyro.unhurried_scenario(tmp_path / "board.toml")) as there:
        link = ("--hil-bench", "s-slow", "--hil-link", there.url)
        result = run(pytester, text, *link)
        result.assert_outcomes(passed=1, skipped=2)
        assert "arming a board that is not emulated needs --hil-arm" in result.stdout.str()
        run(pytester, text, *link, "--hil-arm").assert_outcomes(passed=2, skipped=1)


@pytest.mark.long
@pytest.mark.parametrize(
    ("link", "chosen", "outcomes"),
    [
        ("inproc:s-slow", "not closed_loop", {"passed": 5, "skipped": 1}),  # lockstep knows no silence
        ("pty:s-slow", "says or registers or silent or noise", {"passed": 4}),
    ],
)
def test_the_examples_pass_on_every_link(
    pytester: pytest.Pytester, link: str, chosen: str, outcomes: dict[str, int]
) -> None:
    pytester.copy_example(str(ROOT / "examples" / "tests" / "pytest.ini"))
    pytester.copy_example(str(ROOT / "examples" / "tests" / "test_acceptance.py"))
    pytester.runpytest_subprocess(*PLUGIN, "--hil-link", link, "-k", chosen).assert_outcomes(**outcomes)


@pytest.mark.long
def test_the_examples_find_a_noisy_board(pytester: pytest.Pytester, tmp_path: Path) -> None:
    pytester.copy_example(str(ROOT / "examples" / "tests" / "pytest.ini"))
    pytester.copy_example(str(ROOT / "examples" / "tests" / "test_acceptance.py"))
    noisy = gyro.scenario(tmp_path / "noisy.toml", sense={"noise_V": 1.5e-4})
    result = pytester.runpytest_subprocess(*PLUGIN, "--hil-link", f"inproc:{noisy}", "-k", "noise or says")
    result.assert_outcomes(passed=1, failed=1)


@pytest.mark.slow
@pytest.mark.parametrize(("error", "code"), [("KeyError('x')", 3), ("AssertionError()", 1)])
def test_a_fault_of_the_bench_is_no_verdict_on_a_board(pytester: pytest.Pytester, error: str, code: int) -> None:
    text = f"""
        from hil.testing.board import BoardUnderTest

        def test_it(monkeypatch):
            def broken(*_):
                raise {error}
            monkeypatch.setattr(BoardUnderTest, "_connected", broken)
            board = object.__new__(BoardUnderTest)
            board._connection = None
            board.endpoint
    """
    assert run(pytester, text).ret == code


@pytest.mark.long
def test_a_failure_is_one_line_and_says_where_its_record_is(pytester: pytest.Pytester) -> None:
    pytester.makefile(".csv", ride="a,b\n1,2\n2,3\n")
    text = """
        def test_of_a_verdict(board):
            run = board.run(duration_s=0.3)
            assert run.result.verdict == "unsafe"

        def test_of_an_option(board):
            board.run(gain=3)

        def test_of_a_map(record):
            raise AssertionError
        """
    given = ("--hil-bench", "s-slow", "--hil-link", "inproc:s-slow", "--hil-record", "ride.csv", "--junit-xml", "j.xml")
    result = run(pytester, text, *given)
    result.assert_outcomes(failed=2, errors=1)
    said = result.stdout.str()
    (folder,) = re.findall(r"^folder: (.+)$", said, re.MULTILINE)
    assert f"report: {folder}/report.html" in said
    assert f"shown by: hil show {folder}" in said
    assert Path(folder, "result.json").exists()
    assert f'<property name="hil folder" value="{folder}"' in (pytester.path / "j.xml").read_text()
    assert re.search(r"^\S+\.py:6: the test: \[loop\] gain: unknown key", said, re.MULTILINE)
    assert "others need --hil-map" in said
    assert "During handling" not in said
    assert "/hil/" not in said
