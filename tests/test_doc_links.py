"""Every link from a page to a place in this tree leads somewhere: to a file, and to a heading of it.  Every file that a
page, a docstring or a comment names is there.
"""

import re
from pathlib import Path

import pytest

TREE = Path(__file__).parents[1]
ROOMS = ("benchmarks", "device_emulator", "docs", "estimator", "evaluation", "examples", "firmware", "hil", "tests")
PAGES = [TREE / "README.md", *sorted((TREE / "docs").rglob("*.md"))]

_LINK = re.compile(r"\]\(([^)\s]+)\)")
_HEADING = re.compile(r"^#+ (.+)$", re.MULTILINE)
_PAGE = re.compile(r"(?<![\w./-])(?:\.\./)*([\w./-]*\w\.md)\b")
_PATH = re.compile(rf"`((?:{'|'.join(ROOMS)})/[\w./-]+\.(?:py|md|toml|json))`")
_CODE = re.compile(r"^```.*?^```|`[^`\n]*`", re.MULTILINE | re.DOTALL)


def anchors(page: Path) -> set[str]:
    """As a forge makes them of headings: small letters, spaces as hyphens, other signs left out."""
    headings = _HEADING.findall(page.read_text(encoding="utf-8"))
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(TREE)))
def test_links_lead_somewhere(page: Path) -> None:
    wrong = []
    for link in _LINK.findall(_CODE.sub("", page.read_text(encoding="utf-8"))):
        if "://" in link or link.startswith("mailto:"):
            continue
        name, _, anchor = link.partition("#")
        target = (page.parent / name).resolve() if name else page
        if not target.exists() or (anchor and target.suffix == ".md" and anchor not in anchors(target)):
            wrong.append(link)
    assert wrong == []


@pytest.mark.moderate
def test_pages_docstrings_and_comments_name_files_that_are_here() -> None:
    """A page is any word that ends in .md.  Any other file counts by its path from the top, in backquotes, since
    `my.bench.toml` and `result.json` are a user's.
    """
    files = [path for room in ROOMS for path in (TREE / room).rglob("*.*") if path.suffix != ".pyc"]
    names = {path.relative_to(TREE).as_posix() for path in [*TREE.glob("*.*"), *files]}
    tails = {"/".join(parts[k:]) for parts in (name.split("/") for name in names) for k in range(len(parts))}
    wrong = set()
    for path in [*TREE.glob("*.md"), *files]:
        if path.suffix in {".py", ".md"}:
            lines = [line for line in path.read_text(encoding="utf-8").splitlines() if ".md" in line or "`" in line]
            named = {name for line in lines for name in [*_PAGE.findall(line), *_PATH.findall(line)]}
            wrong |= {(path.relative_to(TREE).as_posix(), name) for name in named - tails}
    assert wrong == set()
