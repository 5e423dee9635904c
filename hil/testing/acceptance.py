"""Every rule that docs/wire.md and docs/safety.md have for a board, asked of one; a page of the answers.

The rules are the tests that the bench's own boards keep (`hil.testing.board_rules`).
"""

import ast
import os
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from textwrap import dedent
from typing import Any

from hil.boards.emulation import served
from hil.errors import InputError
from hil.progress import Progress, Watcher
from hil.records.atomic import make_run_folder, write_text
from hil.report import markup
from hil.report.verdict import Headline
from hil.running.safety.latching import CUT_THE_SUPPLY

WORDS = "drives of single ticks, up to the largest code of its converters; stops, restarts and damaged frames"
"""What it brings a board, for the one who has to consent."""
_LONG = 300
_LINK = "HIL_ACCEPT_LINK"
"""Read by `hil.testing.board_rules.asked`, which pytest has to be the first to import."""


@dataclass
class Accepted:
    """By rule: those that are kept; those that are not, and how; those that could not be asked, and why.

    unsafe: how the board did not go to SAFE, "" if it always did. No rule was asked after that.
    """

    kept: list[str] = field(default_factory=list)
    broken: dict[str, str] = field(default_factory=dict)
    untried: dict[str, str] = field(default_factory=dict)
    unsafe: str = ""
    folder: Path | None = None

    @property
    def alarm(self) -> str:
        """What to do first about a board that may still be driven, else nothing."""
        return f"{CUT_THE_SUPPLY}; {self.unsafe}" if self.unsafe else ""

    @property
    def good(self) -> bool:
        """Whether there was something to keep, and all of it was kept."""
        return bool(self.kept) and not (self.broken or self.unsafe)

    def as_json(self) -> dict[str, Any]:
        """The same in JSON values."""
        rules = {"kept": self.kept, "broken": self.broken, "untried": self.untried}
        return {"unsafe": self.unsafe or None, **rules, "folder": str(self.folder)}


def accept(link: str, out: Path, progress: Watcher) -> Accepted:
    """Ask the board at `link`; `accept.html` in a new folder below `out`.

    Raises InputError where pytest is missing, and as `hil.run` where nobody answers.
    """
    try:
        import pytest
    except ImportError:
        raise InputError("--accept: the rules are pytest tests; pip install pytest") from None
    from hil.boards.identity import identity_at

    identity = identity_at(link)
    answers = Accepted(folder=make_run_folder(out, "accept"))
    collector = _Collector(answers, lambda done, total, name: progress(Progress("accept", done, total, note=name)))
    place = Path(__file__).with_name("board_rules") / "asked.py"
    with served(link) as board, pytest.MonkeyPatch.context() as environment:
        environment.setenv(_LINK, board.url)
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
        self._came = ""
        self._why: dict[str, str] = {}

    def pytest_configure(self) -> None:
        import pytest

        pytest.register_assert_rewrite("hil.testing.board_rules")  # or an assertion says nothing

    def pytest_assertrepr_compare(self, op: str, left: Any, right: Any) -> None:
        self._came = f"{op} {_told(right)}, came {_told(left)}"

    def pytest_runtest_makereport(self, item: Any, call: Any) -> None:
        from hil.testing.board_rules.served import NotSafe

        if call.excinfo is None:
            return
        self._why[item.nodeid] = _sentence(call.excinfo, self._came)
        self._came = ""
        if isinstance(call.excinfo.value, NotSafe):
            self._answers.unsafe = str(call.excinfo.value)
            item.session.shouldstop = self._answers.unsafe

    def pytest_collection_finish(self, session: Any) -> None:
        self._total = len(session.items)

    def pytest_runtest_logreport(self, report: Any) -> None:
        rule = report.nodeid.rpartition("::")[2].removeprefix("test_").replace("_", " ")
        if report.skipped:
            self._answers.untried[rule] = str(report.longrepr[2] if report.longrepr else "").removeprefix("Skipped: ")
        elif report.failed:
            words = self._why.get(report.nodeid) or str(report.longrepr)
            self._answers.broken.setdefault(rule, " ".join(words.split())[:_LONG])
            self._answers.kept = [kept for kept in self._answers.kept if kept != rule]  # it fails when it is left
        elif report.when == "call":
            self._answers.kept.append(rule)
        if report.when == "teardown":
            self._done += 1
            self._told(self._done, self._total, rule)


def _told(value: Any) -> str:
    """A value as a sentence has it: messages and enumerations by their names."""
    if isinstance(value, Enum):
        return value.name
    if type(value) in (tuple, list):
        return f"({', '.join(map(_told, value))})"
    return "none" if value is None else repr(value)


def _sentence(excinfo: Any, compared: str) -> str:
    """What was expected and what came; compared: what pytest says of a comparison that does not hold."""
    from hil.wire.client import Refused
    from hil.wire.errors import LinkError

    error, text = excinfo.value, str(excinfo.value)
    if text.startswith("expected"):
        return text.partition("\nassert ")[0]
    if isinstance(error, Refused):
        return f"expected no refusal, came: {text}"
    if isinstance(error, LinkError):
        return f"expected an answer, came none: {text}"
    if found := re.match(r"DID NOT RAISE <class '.*?(\w+)'>", text):
        return f"expected {found[1]}, came no error"
    source = " ".join(str(excinfo.traceback[-1].statement).split())
    if not isinstance(error, AssertionError):
        return f"expected {source}, came {type(error).__name__}: {text}"
    try:
        (statement,) = ast.parse(dedent(str(excinfo.traceback[-1].statement))).body
    except SyntaxError:
        return f"expected {source}, came something else"
    tested = statement.test if isinstance(statement, ast.Assert) else statement
    if compared and isinstance(tested, ast.Compare) and len(tested.ops) == 1:
        return f"expected {ast.unparse(tested.left)} {compared}"
    found = re.search(r"where False = isinstance\((.*), [^,]*\)$", text, re.MULTILINE)
    return f"expected {ast.unparse(tested)}, came {found[1] if found else 'False'}"


def _page(answers: Accepted, link: str, board: str, firmware: str) -> str:
    kept, broken = len(answers.kept), len(answers.broken)
    word = "Unsafe" if answers.unsafe else "Kept" if answers.good else "Not kept"
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
        alarm=answers.alarm[:1].upper() + answers.alarm[1:],
        sections="".join(sections),
        facts=(f"board {board}", f"firmware {firmware}", "docs/wire.md, docs/safety.md"),
    )


def _table(rows: dict[str, str], what: str) -> str:
    return markup.table("Rules", ("rule", what), list(rows.items())) if rows else ""
