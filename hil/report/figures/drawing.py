"""What a figure module gives back."""

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Drawing(NamedTuple):
    """A figure, and its words: title, caption for all, description for those who do not see it."""

    figure: "Figure"
    title: str
    caption: str
    alt: str
