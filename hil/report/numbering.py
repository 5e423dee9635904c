"""Figures drawn one after another, numbered as far as they exist."""

import html
import io
import re
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from hil.report import markup
from hil.report.figures.drawing import Drawing
from hil.report.theme import CSS_VARIABLE, drawing_style

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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
        return markup.figure(self._count, drawing.title, drawing.caption, svg)


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
