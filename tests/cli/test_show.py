"""How a run's verdict looks on the terminal: loudest first, what is good although another part failed, what is next."""

import json
from pathlib import Path

import pytest
import typer

from hil.cli.show import finish
from hil.records.result import Answers, Part, Result, save_result

PARTS = {
    "safety": Part(outcome="good", reason="every stop was confirmed"),
    "machine": Part(outcome="failed", reason="12.00\u00a0% of the samples had no answer in time", next="hil doctor"),
    "model": Part(outcome="complete", reason="nothing is missing"),
    "angle": Part(outcome="good", reason="± 1.9 mrad"),
}
ANSWERS = Answers(
    ticks=1000, in_time=870, late=20, unanswered=90, lost_to_board=10, lost_to_host=6, stopped=4, slow=15
)  # fmt: skip


def shown(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], *, as_json: bool = False, **given: object
) -> tuple[int, list[str], str]:
    """Exit code, lines on standard output, and standard error."""
    known = {"run": "r", "seconds": 1.0, "samples": 990, "lost": 10, "complete": True, "answers": ANSWERS}
    save_result(tmp_path / "result.json", Result.model_validate(known | given))
    with pytest.raises(typer.Exit) as left:
        finish(tmp_path, as_json=as_json)
    out, err = capfd.readouterr()
    return left.value.exit_code, out.splitlines(), err


def line(lines: list[str], start: str) -> str:
    (found,) = [line for line in lines if line.startswith(start)]
    return found


def test_the_count_is_told_and_adds_up(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    _, lines, _ = shown(tmp_path, capfd, verdict="good", parts=PARTS)
    assert line(lines, "answered in time").endswith("870 of 1000 (87.00\u00a0%)")
    others = line(lines, "the others").split(maxsplit=2)[2]
    assert others == (
        "20 answered late, 90 not answered, 10 lost on the way to the board, 6 lost on the way to the host, "
        "4 while the board was SAFE"
    )
    assert 870 + sum(int(word) for word in others.split() if word.isdigit()) == 1000


def test_each_part_says_what_it_came_to(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    reasons = (PARTS["machine"].reason,)
    code, lines, _ = shown(tmp_path, capfd, verdict="failed", parts=PARTS, reasons=reasons, next="hil doctor")
    assert code == 1
    start = lines.index("verdict  failed: machine")
    assert [row.split(maxsplit=2) for row in lines[start + 1 : start + 5]] == [
        [name, part.outcome, part.reason] for name, part in PARTS.items()
    ]
    assert sum(PARTS["machine"].reason in row for row in lines) == 1
    assert lines[-1] == "next     hil doctor"


def test_what_is_lacking_is_said_once(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    parts = PARTS | {"model": Part(outcome="lacks", reason="lacks drag: dq = 1 1/m")}
    _, lines, _ = shown(tmp_path, capfd, verdict="failed", parts=parts)
    assert any(row.split() == ["model", "lacks", "drag:", "dq", "=", "1", "1/m"] for row in lines)


def test_truth_has_a_column_where_it_is_known_only(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    known = {"value": 1.0, "ci95": (0.5, 1.5), "unit": "1/s"}
    _, lines, _ = shown(tmp_path, capfd, parameters={"dxx": known})
    assert (line(lines, "parameter").split()[-1], line(lines, "dxx").split()) == (
        "interval", ["dxx", "1.00", "0.50", "1.50", "1/s"],
    )  # fmt: skip
    _, lines, _ = shown(tmp_path, capfd, parameters={"dxx": known | {"truth": 1.25}, "dyy": known})
    assert line(lines, "parameter").split()[-1] == "truth"
    assert line(lines, "dxx").split() == ["dxx", "1.00", "0.50", "1.50", "1.25", "1/s"]


@pytest.mark.parametrize(("expanded", "words"), [(None, "good; the angle's uncertainty is unknown"), (1e-3, "good")])
def test_good_without_an_uncertainty_of_the_angle_says_so(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], expanded: float | None, words: str
) -> None:
    angle = {"kind": "pattern", "why": "mine", "rad": 0.1}
    code, lines, _ = shown(
        tmp_path, capfd, verdict="good", parts=PARTS | {"machine": PARTS["safety"]}, angle=angle,
        angle_u_rad=None if expanded is None else 0.5 * expanded, angle_expanded_rad=expanded,
    )  # fmt: skip
    assert code == 0
    assert line(lines, "verdict") == f"verdict  {words}"


def test_a_constant_that_nothing_estimated_is_declared(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    given = {"value": 0.69, "ci95": None, "unit": "1/s"}
    _, lines, _ = shown(tmp_path, capfd, parameters={"dxx": {**given, "declared": True}, "dyy": given})
    assert line(lines, "dxx").split() == ["dxx", "0.690000", "declared", "1/s"]
    assert line(lines, "dyy").split() == ["dyy", "0.690000", "not", "given", "1/s"]


def test_a_part_that_nobody_could_judge_is_left_out(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    parts = PARTS | {"machine": Part(outcome="unknown"), "model": Part(outcome="unknown", reason="too short")}
    _, lines, _ = shown(tmp_path, capfd, verdict="good", parts=parts)
    assert not any(row.split()[:1] == ["machine"] for row in lines)
    assert any(row.split() == ["model", "unknown", "too", "short"] for row in lines)


def test_unsafe_comes_before_anything_else(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    alarm = "the board did not confirm SAFE: cut the supply"
    parts = PARTS | {"safety": Part(outcome="unsafe", reason=alarm, next="cut the supply")}
    code, lines, _ = shown(tmp_path, capfd, verdict="unsafe", parts=parts, next="cut the supply")
    assert code == 1
    assert lines[0].split(maxsplit=1) == ["UNSAFE", alarm]
    assert lines[-1] == "next     cut the supply"


def test_unsafe_is_heard_beside_json(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    parts = PARTS | {"safety": Part(outcome="unsafe", reason="cut the supply")}
    code, _, err = shown(tmp_path, capfd, as_json=True, verdict="unsafe", parts=parts)
    assert (code, err) == (1, "UNSAFE: cut the supply\n")


def test_why_a_run_ended_early_stands_under_the_verdict(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    code, lines, _ = shown(tmp_path, capfd, verdict="interrupted", parts=PARTS, reasons=("stopped on request",))
    assert code == 1
    assert lines[lines.index("verdict  interrupted") + 1].strip() == "stopped on request"


def test_many_remarks_do_not_push_the_verdict_away(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    remarks = tuple(f"armed again, {k}" for k in range(93))
    _, lines, _ = shown(tmp_path, capfd, verdict="good", parts=PARTS, remarks=remarks)
    told = [row for row in lines if row.startswith("remark")]
    assert told[0].endswith("armed again, 0")
    assert (len(told), told[-1]) == (9, "remark   … and 85 more in result.json")


def test_a_record_without_a_verdict_has_none(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    code, lines, _ = shown(tmp_path, capfd, answers=None, lost=3)
    assert code == 0
    assert line(lines, "lost").split() == ["lost", "3"]
    assert not any(row.startswith(("verdict", "next")) for row in lines)


EVIL = "a\x1b[31mred\x07\u202egnirts\x9b2J\u2028next\r\n[bold]x[/]\x7f\U000e0001"
"""What a terminal would obey, from a board, an operator or a file."""


def obeyed(text: str) -> list[str]:
    """What of a text a terminal would obey or hide, line feeds and the spaces within numbers excepted."""
    return [ascii(mark) for mark in text if not mark.isprintable() and mark not in "\n\u00a0\u202f"]


def test_nothing_that_a_terminal_obeys_comes_through(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    bad = Part(outcome="failed", reason=EVIL, next=EVIL + " again")
    parts = {"safety": Part(outcome="unsafe", reason=EVIL, next=EVIL), "machine": bad, "model": bad, "angle": bad}
    parameter = {"value": 1.0, "ci95": (0.5, 1.5), "unit": EVIL}
    evil = {"run": EVIL, "link": EVIL, "clock": "paced", "next": EVIL, "reasons": (EVIL, EVIL), "remarks": (EVIL,)}
    evil |= {"operator_note": EVIL, "parameters": {EVIL: parameter}, "counters": {EVIL: 1}}
    for as_json in (False, True):
        _, lines, err = shown(tmp_path, capfd, as_json=as_json, verdict="unsafe", parts=parts, **evil)
        assert not obeyed("\n".join(lines) + err)
        assert "red" in lines[0] + err
    told = json.loads("\n".join(lines))
    assert (told["next"], told["parts"]["safety"]["reason"], told["operator_note"]) == (EVIL, EVIL, EVIL)


def test_a_run_folder_of_any_name(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    place = tmp_path / EVIL.replace("/", "")
    place.mkdir()
    (place / "report.html").touch()
    _, lines, _ = shown(place, capfd, verdict="good", parts=PARTS)
    assert not obeyed("\n".join(lines))
    assert line(lines, "report").endswith("report.html")
