"""A fault of the program is one line with exit code 3: not the code of a verdict, no traceback on the terminal."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from hil import cli
from hil.errors import ending
from hil.errors.ending import fault_line, is_fault, kept_fault
from tests.cli.conftest import Hil

REFERENCE = Path(__file__).parents[2] / "docs" / "reference" / "cli.md"


def broken(*_: object, **__: object) -> None:
    raise ValueError("array must not contain\ninfs or NaNs")


def test_a_fault_is_one_line_and_its_traceback_a_file(
    hil: Hil, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr("hil.sweeping.request.find", broken)
    code, out, err = hil("sweep", "s-slow-noise", "--dry-run")
    assert (code, out) == (3, "")
    assert err.count("\n") == 1
    assert err.startswith(
        "hil: a fault of hil: ValueError: array must not contain infs or NaNs; please report it with "
    )
    text = Path(err.rstrip().rpartition(" ")[2]).read_text()
    assert "Traceback" in text
    assert "in broken" in text


def test_a_fault_that_cannot_be_written_is_printed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(ending.tempfile, "mkstemp", lambda **_: (_ for _ in ()).throw(OSError(28, "no space")))
    assert kept_fault(KeyError("x")).endswith("; please report it with the lines above")
    assert "KeyError" in capsys.readouterr().err


def test_a_line_knows_whether_it_speaks_of_a_fault() -> None:
    assert is_fault(f"its process died, 2 times: {fault_line(KeyError('x'))}")
    assert not is_fault("its process died, 2 times: SIGKILL")
    assert not is_fault(None)


def test_every_code_is_told_on_the_page_and_in_the_help(hil: Hil) -> None:
    _, out, _ = hil("--help")
    page = REFERENCE.read_text(encoding="utf-8")
    for code in ending.ExitCode:
        assert f"| {code.value} |" in page
        assert f" {code.value} " in " ".join(out.partition("Exit codes:")[2].split()).join("  ")


def test_a_run_whose_loop_failed_ends_with_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The verdict's reasons tell of it; the same run without them ends with 1."""
    import typer

    from hil.cli import show

    class Result:
        verdict, reasons = "failed", (f"the loop failed, {fault_line(ValueError('x'))}",)

    (tmp_path / "result.json").write_text("{}")
    monkeypatch.setattr("hil.records.result.load_result", lambda _: Result)
    for code in (3, 1):
        with pytest.raises(typer.Exit) as left:
            show.finish(tmp_path, as_json=True)
        assert left.value.exit_code == code
        Result.reasons = ("late_fraction",)


def test_the_process_of_a_campaign_ends_with_it() -> None:
    said = subprocess.run(
        [sys.executable, "-m", "hil.sweeping.child"], input="no task\n", capture_output=True, text=True, check=False
    )
    assert said.returncode == 3
    assert is_fault(json.loads(said.stdout)["died"])


def test_a_job_ends_with_it(tmp_path: Path) -> None:
    from hil.service.jobs.child import ORDER, OUTCOME

    tmp_path.joinpath(ORDER).write_text(json.dumps({"do": {"kind": "no such kind"}, "out": str(tmp_path)}))
    words = [sys.executable, "-m", "hil.service.jobs.child", str(tmp_path)]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as child:
        code = child.wait(60.0)  # its input stays open: the service is there
    outcome = json.loads((tmp_path / OUTCOME).read_text())
    assert outcome["state"] == "failed"
    assert (code, is_fault(outcome["error"])) == (3, True)


def test_a_users_mistake_is_none(hil: Hil) -> None:
    assert hil("replay", "nowhere.arrow", "--bench", "silverbox")[0] == 2
    assert cli.execute(["--help"]) == 0
