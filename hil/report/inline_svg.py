"""A Matplotlib figure as SVG text that can stand in a page among others, take its colours and be read
aloud."""

import html
import io
import re
from typing import TYPE_CHECKING

from hil.report.theme import CSS_VARIABLE

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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
