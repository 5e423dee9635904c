"""The few pieces of HTML that the page is made of. Every text that comes from outside is escaped here."""

import html
import io
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from html import escape
from importlib.resources import files
from typing import TYPE_CHECKING

import numpy as np

from hil.numbers import counted
from hil.report.theme import CSS_VARIABLE, Drawing, drawing_style
from hil.report.verdict import Headline

if TYPE_CHECKING:
    from matplotlib.figure import Figure


Row = Sequence[str]
_LONG = 30
"""Letters from which on a cell is a sentence."""
_MANY = 8
"""Columns that the width of the text has room for."""
_TYPED = ("hil ", "sudo ", "xdg-open ")


def page(
    *,
    kind: str,
    title: str,
    line: Headline,
    key: str,
    sections: str,
    alarm: str = "",
    verdict: str = "",
    facts: Iterable[str] = (),
) -> str:
    """A whole page. `line` is its verdict; `key`, `sections` and `verdict`, which stands below
    the sentence, are HTML already. `alarm` stands above everything; `facts` are in a line below the title: when, what,
    how long. The contents are those of the sections."""
    report = files("hil.report")
    text = report.joinpath("page.html").read_text(encoding="utf-8")
    values = {
        "kind": escape(kind),
        "title": escape(title),
        "style": report.joinpath("style.css").read_text(encoding="utf-8"),
        "tone": line.tone,
        "facts": _line("facts", map(escape, facts)),
        "contents": _line("contents", _contents(sections), "nav"),
        "word": escape(line.word),
        "sentence": escape(line.sentence),
        "alarm": f'<p class="alarm" role="alert"><strong>Unsafe.</strong> {escape(alarm)}</p>' if alarm else "",
        "parts": verdict,
        "key": key,
        "sections": sections,
    }
    for name, value in values.items():
        text = text.replace(f"<!-- {name} -->", value)
    return text


def _line(kind: str, items: Iterable[str], tag: str = "p") -> str:
    """Items side by side, nothing without any."""
    shown = "".join(f"<span>{item}</span> " for item in items)
    return f'<{tag} class="{kind}">{shown}</{tag}>' if shown else ""


def _contents(sections: str) -> Iterable[str]:
    """A link to each section, by the headings of `section`."""
    return (f'<a href="#{key}">{title}</a>' for key, title in re.findall(r'<h2 id="([^"]+)">(.*?)</h2>', sections))


def table(caption: str, head: Row, rows: Iterable[Row], numbers: Collection[int] = ()) -> str:
    """A table with header cells, which a keyboard can scroll where it is wider than the screen.

    Columns in `numbers` are set flush right, those of sentences kept wide enough to read on a phone.
    """
    rows = list(rows)
    kinds = {index: "long" for row in rows for index, cell in enumerate(row) if len(cell) > _LONG}
    kinds |= dict.fromkeys(numbers, "n")
    heading = "".join(
        f'<th scope="col"{_class(index, kinds)}>{escape(cell)}</th>' if cell else "<td></td>"  # nothing to read aloud
        for index, cell in enumerate(head)
    )
    body = "".join(f"<tr>{_cells(row, kinds)}</tr>" for row in rows)
    broad = " broad" if len(head) > _MANY else ""
    return (
        f'<div class="wide{broad}" tabindex="0"><table><caption>{escape(caption)}</caption>'
        f"<thead><tr>{heading}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def figure(number: int, title: str, caption: str, svg: str) -> str:
    return (
        f'<figure id="figure-{number}"><div class="plot" tabindex="0">{svg}</div><figcaption><b>Figure {number}. '
        f"{escape(title)}.</b> {escape(caption)}</figcaption></figure>"
    )


def key_figures(entries: Iterable[tuple[str, str, str]]) -> str:
    """The row of headline numbers: (what, number, remark)."""
    cells = "".join(
        f"<div><dt>{escape(what)}</dt><dd>{escape(number)}<small>{escape(remark)}</small></dd></div>"
        for what, number, remark in entries
    )
    return f'<dl class="key">{cells}</dl>'


def verdict(parts: Iterable[tuple[str, str, str, str, str]], command: str | None) -> str:
    """The parts of a verdict, (tone, name, outcome, reason, next), and the command that comes next."""
    rows = "".join(
        f'<div class="{tone}"><dt>{escape(name)}</dt><dd><b>{escape(outcome)}</b> {escape(reason)}'
        + (f' <span class="do">Next: {_command(after)}</span>' if after and after != command else "")
        + "</dd></div>"
        for tone, name, outcome, reason, after in parts
    )
    listed = f'<dl class="parts">{rows}</dl>' if rows else ""
    return listed + (f'<p class="next">Next: {_command(command)}</p>' if command else "")


def _command(text: str) -> str:
    """In fixed pitch what can be typed, as prose what a person has to do."""
    return f"<code>{escape(text)}</code>" if text.startswith(_TYPED) else escape(text)


def section(key: str, title: str, *parts: str) -> str:
    """A section with its heading; an empty one leaves no trace."""
    content = "".join(parts)
    return f'<section aria-labelledby="{key}"><h2 id="{key}">{escape(title)}</h2>{content}</section>' if content else ""


def paragraph(text: str) -> str:
    """A paragraph of plain text, nothing without any."""
    return f"<p>{escape(text)}</p>" if text else ""


def listing(text: str) -> str:
    """A file as it is, in fixed pitch, folded; nothing of an empty one."""
    if not text:
        return ""
    lines = counted(len(text.splitlines()), "line")
    return f'<details><summary>{lines}</summary><pre tabindex="0"><code>{escape(text)}</code></pre></details>'


def _cells(row: Row, kinds: Mapping[int, str]) -> str:
    first, *rest = row
    cells = "".join(f"<td{_class(index, kinds)}>{escape(cell)}</td>" for index, cell in enumerate(rest, 1))
    return f'<th scope="row"{_class(0, kinds)}>{escape(first)}</th>{cells}'


def _class(index: int, kinds: Mapping[int, str]) -> str:
    return f' class="{kinds[index]}"' if index in kinds else ""


def sentence(text: str) -> str:
    """Words as a sentence: a capital first, unless they begin with a name that has none, and a full stop."""
    first = text.split(" ", 1)[0]
    return (text if "_" in first else text[:1].upper() + text[1:]).rstrip(".") + "."


class Figures:
    """Counts the figures of a page."""

    def __init__(self) -> None:
        self._count = 0

    def add(self, draw: Callable[[], Drawing | None]) -> str:
        """The figure as HTML with its number and caption, "" where there is nothing to draw."""
        # what a diverged observer leaves is not finite, or overflows where it is squared: the captions say so
        with drawing_style(), np.errstate(all="ignore"):
            drawing = draw()
            if drawing is None:
                return ""
            self._count += 1
            svg = inline_svg(drawing.figure, f"f{self._count}", drawing.title, drawing.alt)
        return figure(self._count, drawing.title, drawing.caption, svg)


def inline_svg(figure: "Figure", key: str, title: str, alt: str) -> str:
    """The figure as an `<svg>` element.

    `key` makes its ids unique in the page; `title` and `alt` are its accessible name and description. Equal
    figures give equal text.
    """
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    buffer = io.StringIO()
    # Laid out and drawn once: `savefig` draws all of it a second time, to nothing, for a box that it is not asked for.
    FigureCanvasSVG(figure).print_svg(buffer, metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>\s*", "", text, count=1, flags=re.DOTALL)
    text = re.sub(r'\bid="', f'id="{key}-', text)
    text = re.sub(r'(url\(#|href="#)', rf"\g<1>{key}-", text)
    text = re.sub(r' d="[^"]+"', lambda match: _shorten(match.group()), text)
    for drawn, variable in CSS_VARIABLE.items():
        text = text.replace(drawn, variable)
    names = f'role="img" aria-labelledby="{key}-title {key}-alt"'
    opening = f'<svg viewBox="{_view_box(text)}" {names}>'
    described = f'<title id="{key}-title">{html.escape(title)}</title><desc id="{key}-alt">{html.escape(alt)}</desc>'
    return re.sub(r"<svg[^>]*>", lambda _: opening + described, text, count=1)


def _view_box(text: str) -> str:
    found = re.search(r'viewBox="([^"]+)"', text)
    assert found is not None
    return found.group(1)


def _shorten(path: str) -> str:
    """Hundredths of a point are finer than any screen or printer."""
    return re.sub(r"(\.\d\d)\d+", r"\1", path.replace("\n", ""))
