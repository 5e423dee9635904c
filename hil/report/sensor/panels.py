"""A small panel per axis, side by side, on one scale."""

from typing import TYPE_CHECKING

from hil.report.theme import new_figure

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MOST = 3


def side_by_side(names: list[str], height_in: float) -> "tuple[Figure, list[Axes]]":
    """A figure with a panel titled by each of `names`, at most three in a row, and their panels."""
    columns = min(len(names), _MOST)
    rows = -(-len(names) // columns)
    figure = new_figure(height_in * rows)
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    panels: list[Axes] = list(grid[: len(names)])
    for ax in grid[len(names) :]:
        ax.set_axis_off()
    for ax, name in zip(panels, names, strict=True):
        ax.set_title(name)
    return figure, panels


def legend_of_all(figure: "Figure", panels: "list[Axes]") -> None:
    """One legend above the panels for whatever is drawn in any of them."""
    named: dict[str, Artist] = {}
    for ax in panels:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            named.setdefault(label, handle)
    figure.legend(list(named.values()), list(named), loc="outside upper right", ncols=len(named))
