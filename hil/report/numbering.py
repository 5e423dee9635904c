"""Figures drawn one after another, numbered as far as they exist."""

from collections.abc import Callable

import numpy as np

from hil.report import markup
from hil.report.figures.drawing import Drawing
from hil.report.inline_svg import inline_svg
from hil.report.theme import drawing_style


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
