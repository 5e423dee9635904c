"""Pieces of a page by themselves, without the drawing."""

import re

import pytest

from hil.records.result import Result
from hil.report import markup
from hil.report.verdict import key_figures


def test_the_angle_with_its_uncertainty_stands_first_among_the_figures() -> None:
    known = {"run": "r", "seconds": 1.0, "samples": 990, "lost": 0, "complete": True}
    angle = {"kind": "pattern", "rad": -0.3364}
    entries = key_figures(
        Result.model_validate(known | {"angle": angle, "angle_u_rad": 0.14149, "angle_expanded_rad": 0.28298})
    )
    assert [part.replace("\u00a0", " ") for part in entries[0]] == [
        "Angle", "−336 mrad (−19.3°)", "± 280 mrad (k = 2), since scoring starts",
    ]  # fmt: skip


def test_columns_of_sentences_words_and_numbers_are_told_apart() -> None:
    rows = [("lost", "0", "V"), ("held", "12", "samples before which the board held its last drive")]
    found = markup.table("", ("counter", "count", "meaning"), rows, (1,))
    assert re.findall(r"<th scope=\"col\"([^>]*)>", found) == ["", ' class="n"', ' class="long"']
    assert re.findall(r"<td([^>]*)>", found) == [' class="n"', ' class="long"'] * 2


@pytest.mark.parametrize(
    ("text", "typed"),
    [
        ("hil doctor", True),
        ("xdg-open runs/a/report.html", True),
        ("cut the supply", False),
        ("set [loop] rate_Hz", False),
    ],
)
def test_what_can_be_typed_is_told_from_what_is_to_be_done(text: str, typed: bool) -> None:
    assert (f"<code>{text}</code>" in markup.verdict((), text)) is typed
    assert f"Next: {'<code>' if typed else ''}{text}" in markup.verdict([("bad", "angle", "failed", "", text)], None)
