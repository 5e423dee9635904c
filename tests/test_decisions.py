"""docs/decisions: numbered without a gap, dated, with a status, one page each, and all of them in its index."""

import re
from pathlib import Path

import pytest

DECISIONS = Path(__file__).parents[1] / "docs" / "decisions"
PAGES = sorted(page for page in DECISIONS.glob("*.md") if page.name != "README.md")

_HEAD = re.compile(
    r"# (?P<number>\d{4}) · (?P<title>.+)\n\n"
    r"Date: (?P<date>\d{4}-\d{2}-\d{2})[^.]*\. Status: (?P<status>accepted|superseded by \[(?P<by>\d{4})\])"
)
_ONE_PAGE = 70  # lines
_MOST = 35


def head(page: Path) -> re.Match[str]:
    found = _HEAD.match(page.read_text(encoding="utf-8"))
    assert found, f"{page.name} does not begin with number, title, date and status"
    return found


def test_numbers_follow_one_another_and_dates_too() -> None:
    heads = [head(page) for page in PAGES]
    assert [int(one["number"]) for one in heads] == list(range(1, len(PAGES) + 1))
    assert [one["date"] for one in heads] == sorted(one["date"] for one in heads)
    assert len(PAGES) <= _MOST


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_decision_is_one_page_of_context_decision_consequences(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert page.stem.startswith(f"{head(page)['number']}-")
    assert len(text.splitlines()) <= _ONE_PAGE
    sections = [one for one in re.findall(r"^## (.+)$", text, re.MULTILINE) if one[0] in "CD"]
    assert sections[:2] == ["Context", "Decision"]
    assert "Consequences" in sections


def test_the_index_lists_every_page_with_its_date_and_status() -> None:
    rows = []
    for page in PAGES:
        one = head(page)
        status = f"superseded by {one['by']}" if one["by"] else one["status"]
        rows.append(f"| [{one['number']}]({page.name}) | {one['title']} | {one['date']} | {status} |")
    assert "\n".join(rows) + "\n\n" in (DECISIONS / "README.md").read_text(encoding="utf-8")
