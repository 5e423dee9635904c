"""Judging by the truth: classes, members, coverage, misnaming, bounds, and the counts made of them."""

from pathlib import Path
from typing import Any

import pytest

from evaluation.undeclared.judging import Judgement, judge
from evaluation.undeclared.page import write_page
from evaluation.undeclared.summary import summarise

DEVICE = {
    "gain_V_per_m": -800.0,
    "stiffness_per_s2": [1.6e6, 1.5e6, 1e4],
    "damping_per_s": [1.2, 1.0, 0.0],
    "sample_rate_Hz": 4000.0,
}


def truth(category: str, *hidden: tuple[str, dict[str, Any]]) -> dict[str, Any]:
    effects = [{"name": name, "size": 0.01, "tables": [table], "sections": {}} for name, table in hidden]
    return {
        "name": f"{category}-000",
        "category": category,
        "effects": effects,
        "device": DEVICE,
        "noise_V": 1e-4,
        "innovation_ratio": 1.5,
    }


def interval(value: float, half: float) -> dict[str, Any]:
    return {"value": value, "ci95": [value - half, value + half], "unit": "1"}


def said(
    verdict: str,
    *effects: tuple[str, dict[str, Any]],
    separations: Any = (),
    rejected: Any = (),
    ratio: float | None = 1.01,
) -> dict[str, Any]:
    return {
        "verdict": verdict,
        "effects": [{"name": name, "coefficients": coefficients} for name, coefficients in effects],
        "ambiguity_groups": [[a, b] for a, b, _ in separations],
        "separations": [{"effect": a, "with": b, "separate_by": how} for a, b, how in separations],
        "rejected": [{"name": name, "reason": "", "bound": bound} for name, bound in rejected],
        "held_out": {
            "before": {"innovation_rms": 3e-4, "ratio": 3.0},
            "after": {"innovation_rms": 1.01e-4, "ratio": ratio},
        },
    }


GAIN = ("sense_gain", {"name": "sense_gain", "gy": 0.02})
CUBIC = ("cubic_stiffness", {"name": "cubic_stiffness", "k3x": 1e13, "k3y": 2e13})
BACKLASH = ("backlash", {"name": "backlash", "kbx": 1e3, "kby": 1e3, "gap": 1e-5})


def test_the_right_name_and_its_interval() -> None:
    judged = judge(truth("single", GAIN), said("explained", ("sense_gain", {"gy": interval(0.0195, 0.001)})))
    assert judged.first_class
    assert judged.first_member
    assert judged.alone
    assert not judged.misnamed
    assert judged.covered == {"gy": True}
    assert judged.error["gy"] == pytest.approx(-0.5)
    assert judged.after == pytest.approx(1.01)
    assert judged.column == "sense_gain"
    more = judge(truth("single", GAIN), said("explained", ("sense_gain", {}), ("dry_friction", {})))
    assert summarise([judged, more])["single"]["surplus"] == 1


def test_an_interval_beside_the_truth_is_counted() -> None:
    found = {"k3x": interval(1e13, 1e11), "k3y": interval(1.9e13, 1e11)}
    judged = judge(truth("single", CUBIC), said("explained", ("cubic_stiffness", found)))
    assert judged.covered == {"k3x": True, "k3y": False}
    assert summarise([judged])["single"]["coverage"] == 0.5


def test_another_member_of_the_class_is_the_right_class_only() -> None:
    answer = said("explained", ("drive_gain", {}), separations=[("drive_gain", "sense_gain", "a varying rate")])
    judged = judge(truth("single", GAIN), answer)
    assert judged.first_class
    assert not judged.first_member
    assert not judged.alone
    assert not judged.misnamed


def test_a_wrong_name_is_misnamed_unless_something_is_confusable_with_it() -> None:
    wrong = judge(truth("outside", BACKLASH), said("explained", ("cubic_stiffness", {})))
    careful = judge(
        truth("outside", BACKLASH),
        said("explained", ("cubic_stiffness", {}), separations=[("cubic_stiffness", "dry_friction", None)]),
    )
    silent = judge(truth("outside", BACKLASH), said("unexplained", ("cubic_stiffness", {})))
    reserved = judge(truth("outside", BACKLASH), said("partly explained", ("cubic_stiffness", {})))
    assert (reserved.right, reserved.misnamed, reserved.column) == (True, False, "partly explained")
    assert [j.misnamed for j in (wrong, careful, silent)] == [True, False, False]
    assert silent.column == "unexplained"
    assert summarise([wrong, careful, silent])["outside"] == {
        "n": 3,
        "not_misnamed": 2,
        "not_explained": 1,
        "unexplained": 1,
        "adequate": 0,
    }


@pytest.mark.parametrize(("verdict", "ratio", "broken"), [
    ("explained", 1.1, False),
    ("explained", 1.11, True),
    ("explained", None, True),
    ("partly explained", 1.5, False),
    ("unexplained", 1.5, False),
])  # fmt: skip
def test_what_is_explained_is_at_the_floor(verdict: str, ratio: float | None, broken: bool) -> None:
    judged = judge(truth("single", GAIN), said(verdict, ("sense_gain", {}), ratio=ratio))
    assert judged.broken is broken
    assert summarise([judged])["broken"] == (["single-000"] if broken else [])


def test_what_is_explained_fell() -> None:
    answer = said("explained", ("sense_gain", {}))
    answer["held_out"]["before"]["innovation_rms"] = 1e-4
    assert judge(truth("single", GAIN), answer).broken


def test_two_effects_need_both() -> None:
    hidden = truth("double", CUBIC, GAIN)
    both = judge(hidden, said("explained", ("sense_gain", {"gy": interval(0.02, 0.001)}), ("cubic_stiffness", {})))
    one = judge(hidden, said("explained", ("cubic_stiffness", {}), ("drive_gain", {})))
    assert both.right_class == (True, True)
    assert one.right_class == (True, False)
    assert (both.surplus, one.surplus) == (0, 0)
    assert summarise([both, one])["double"]["both_named"] == 1


def test_labels_of_several_of_a_kind_are_left_off() -> None:
    line = ("interference", {"name": "interference", "ax": 1e-3, "ay": 2e-3, "frequency": 50.0, "phase_x": 0.3,
                             "phase_y": 1.0})  # fmt: skip
    judged = judge(truth("single", line), said("explained", ("interference:2", {"lsx:2": interval(-1.2e-6, 1e-6)})))
    assert judged.first_member
    assert judged.covered == {"lsx": True}


def test_nothing_to_add_is_right_with_a_bound_that_holds() -> None:
    hidden = truth("calm", GAIN)
    held = judge(hidden, said("adequate", rejected=[("sense_gain", {"gy": interval(0.0, 0.03)})]))
    broken = judge(hidden, said("adequate", rejected=[("sense_gain", {"gy": interval(0.0, 0.01)})]))
    unbounded = judge(hidden, said("adequate"))
    assert [j.bounded for j in (held, broken, unbounded)] == [True, False, False]
    counted = summarise([held, broken, unbounded])["calm"]
    assert (counted["right"], counted["adequate"]) == (1, 3)


def test_a_record_that_was_refused_is_neither_right_nor_misnamed() -> None:
    judged = judge(truth("single", GAIN), None)
    assert (judged.first_class, judged.misnamed, judged.column) == (False, False, "refused")
    assert judged.after is None


def test_confusion_counts_what_was_named_first() -> None:
    judged: list[Judgement] = [
        judge(truth("clean"), said("adequate")),
        judge(truth("clean"), said("explained", ("sense_gain", {}))),
        judge(truth("single", GAIN), said("explained", ("sense_gain", {}))),
    ]
    summary = summarise(judged)
    assert summary["confusion"] == {
        "(nothing)": {"adequate": 1, "sense_gain": 1},
        "sense_gain": {"sense_gain": 1},
    }
    assert summary["clean"] == {"n": 2, "adequate": 1, "down_to_noise": 2}
    assert [j.right for j in judged] == [True, False, True]


@pytest.mark.moderate
def test_the_page_has_every_row(tmp_path: Path) -> None:
    judged = [
        judge(truth("single", GAIN), said("explained", ("sense_gain", {"gy": interval(0.02, 0.001)}))),
        judge(truth("outside", BACKLASH), said("unexplained")),
    ]
    write_page(tmp_path, summarise(judged), judged)
    page, picture = (tmp_path / "undeclared.md").read_text(), (tmp_path / "undeclared.svg").read_text()
    assert "| one effect: its class named first | 1 of 1 | 100.0 % | 97 % |" in page
    for name in ("sense_gain", "backlash", "unexplained"):
        assert name in picture
    assert page.count("1.5, 1.5, 1.5") == 2
