"""The figures of a run's page, drawn before there is a page."""

from collections.abc import Callable

from hil.report.figures.angle import angle_figure
from hil.report.figures.parameters import parameters_figure, trims_figure
from hil.report.figures.pattern import pattern_figure
from hil.report.figures.rate import rate_figure
from hil.report.figures.signals import closing_figure, innovation_figure, prediction_figure, signals_figure
from hil.report.figures.spectrum import innovation_spectrum_figure
from hil.report.figures.timing import turnaround_figure
from hil.report.markup import Figures
from hil.report.material import Material
from hil.report.theme import Drawing

_FIGURES: tuple[Callable[[Material], Drawing | None], ...] = (
    closing_figure, angle_figure, rate_figure, parameters_figure, trims_figure, pattern_figure, signals_figure,
    prediction_figure, innovation_figure, innovation_spectrum_figure, turnaround_figure,
)  # fmt: skip
"""In the order of the page, which numbers them."""


def draw_figures(material: Material) -> dict[str, str]:
    """Every figure of the page as HTML, "" where there is nothing to draw, by the name of what draws it."""
    numbered = Figures()
    return {draw.__name__: numbered.add(lambda draw=draw: draw(material)) for draw in _FIGURES}  # type: ignore[misc]
