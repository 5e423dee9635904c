"""Every rule that docs/wire.md and docs/safety.md have for a board, asked of one; a page of the answers.

The rules are the tests that the bench's own boards keep (`hil.testing.board_rules`).
"""

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hil.boards.emulation import served
from hil.errors import InputError
from hil.progress import Progress, Watcher
from hil.records.atomic import make_run_folder, write_text
from hil.report import markup
from hil.report.verdict import Headline

WORDS = "drives of single ticks, up to the largest code of its converters; stops, restarts and damaged frames"
"""What it brings a board, for the one who has to consent."""
_LONG = 300


@dataclass
class Accepted:
    """By rule: those that are kept; those that are not, and how; those that could not be asked, and why."""

    kept: list[str] = field(default_factory=list)
    broken: dict[str, str] = field(default_factory=dict)
    untried: dict[str, str] = field(default_factory=dict)
    folder: Path | None = None

    @property
    def good(self) -> bool:
        """Whether there was something to keep, and all of it was kept."""
        return bool(self.kept) and not self.broken

    def as_json(self) -> dict[str, Any]:
        """The same in JSON values."""
        return {"kept": self.kept, "broken": self.broken, "untried": self.untried, "folder": str(self.folder)}


def accept(link: str, out: Path, progress: Watcher) -> Accepted:
    """Ask the board at `link`; `accept.html` in a new folder below `out`.

    Raises InputError where pytest is missing, and as `hil.run` where nobody answers.
    """
    try:
        import pytest
    except ImportError:
        raise InputError("--accept: the rules are pytest tests; pip install pytest") from None
    from hil.boards.identity import identity_at
    from hil.testing.board_rules.asked import LINK

    identity = identity_at(link)
    answers = Accepted(folder=make_run_folder(out, "accept"))
    collector = _Collector(answers, lambda done, total, name: progress(Progress("accept", done, total, note=name)))
    place = Path(__file__).with_name("board_rules") / "asked.py"
    with served(link) as board, pytest.MonkeyPatch.context() as environment:
        environment.setenv(LINK, board.url)
        environment.setenv("PYTEST_ADDOPTS", "")
        options = ["-p", "no:terminal", "-p", "no:cacheprovider", "-c", os.devnull, "--rootdir", str(place.parent)]
        pytest.main([str(place), *options, "-W", "ignore"], plugins=[collector])
    if not (answers.kept or answers.broken or answers.untried):
        raise InputError(f"{link}: no rule was asked of the board; `python -m pytest {place}` says why")
    assert answers.folder is not None
    write_text(answers.folder / "accept.html", _page(answers, link, f"{identity.unique_id:016x}", identity.version))
    return answers


class _Collector:
    """A plug-in of pytest that notes what came of each test."""

    def __init__(self, answers: Accepted, told: Callable[[int, int, str], None]) -> None:
        self._answers, self._told = answers, told
        self._total = self._done = 0

    def pytest_collection_finish(self, session: Any) -> None:
        self._total = len(session.items)

    def pytest_runtest_logreport(self, report: Any) -> None:
        rule = report.nodeid.rpartition("::")[2].removeprefix("test_").replace("_", " ")
        if report.skipped:
            self._answers.untried[rule] = str(report.longrepr[2] if report.longrepr else "").removeprefix("Skipped: ")
        elif report.failed:
            crash = getattr(report.longrepr, "reprcrash", None)
            words = " ".join(str(report.longrepr if crash is None else crash.message).split())
            self._answers.broken[rule] = words[:_LONG]
        elif report.when == "call":
            self._answers.kept.append(rule)
        if report.when == "teardown":
            self._done += 1
            self._told(self._done, self._total, rule)


def _page(answers: Accepted, link: str, board: str, firmware: str) -> str:
    kept, broken = len(answers.kept), len(answers.broken)
    word = "Kept" if answers.good else "Not kept"
    sentence = f"{kept} rules are kept" if answers.good else f"{broken} of {kept + broken} rules are not kept"
    sections = [
        markup.section("broken", "Not kept", _table(answers.broken, "what was seen")),
        markup.section("untried", "Not asked", _table(answers.untried, "why")),
        markup.section("kept", "Kept", markup.table("Rules", ("rule",), [(rule,) for rule in answers.kept])),
    ]
    return markup.page(
        kind="Gyro bench · acceptance of a board",
        title=link,
        line=Headline("good" if answers.good else "bad", word, sentence),
        key="",
        sections="".join(sections),
        facts=(f"board {board}", f"firmware {firmware}", "docs/wire.md, docs/safety.md"),
    )


def _table(rows: dict[str, str], what: str) -> str:
    return markup.table("Rules", ("rule", what), list(rows.items())) if rows else ""
