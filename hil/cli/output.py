"""Words and tables on standard output, as they are, whatever file they come from."""

from collections.abc import Collection, Mapping, Sequence

from hil.errors import printable

_WIDE = 400  # no table is cut where nobody says how wide the terminal is
_FIRST, _GAP = 0.34, 2  # of the width for the first column, where the others need the rest; between columns


class Output:
    """Standard output; `head`, `right`: of a table, its headings, and the columns that stand to the right."""

    def __init__(self) -> None:
        from rich.console import Console

        self._console = Console(highlight=False, soft_wrap=True, width=_WIDE)

    def say(self, text: str = "", *, style: str | None = None, end: str = "\n") -> None:
        """A line, or with another `end` a piece of one."""
        self._console.print(printable(text), style=style, end=end, markup=False)

    def table(
        self, head: Sequence[str], rows: Sequence[Sequence[str]], *, right: Collection[int] = (), fit: int = _WIDE
    ) -> None:
        """Rows of cells below their headings; empty columns are left out. No line is broken, and none is wider than
        `fit`: the first column is broken into lines where the others leave no room, and what does not stand beside it
        follows in a table below.
        """
        from rich.table import Table
        from rich.text import Text

        shown = [column for column in range(len(head)) if any(row[column] for row in rows)]
        wide = {
            column: max(
                len(line) for text in (head[column], *(row[column] for row in rows)) for line in text.split("\n")
            )
            for column in shown
        }
        others = sum(wide[column] + _GAP for column in shown[1:])
        most = max(int(_FIRST * fit), fit - others)
        for columns in _fitting(wide, most, fit):
            made = Table(box=None, pad_edge=False, header_style="dim")
            for column in columns:
                first = column == columns[0] and fit < _WIDE
                made.add_column(
                    head[column], justify="right" if column in right else "left", no_wrap=not first,
                    max_width=most if first else None,
                )  # fmt: skip
            for row in rows:
                made.add_row(*(Text(printable(row[column])) for column in columns))
            self._console.print(made)


def _fitting(wide: Mapping[int, int], most: int, fit: int) -> list[list[int]]:
    """The columns of each table, the first in all of them; `wide`: their widths, of the first `most` are taken."""
    shown = list(wide)
    tables, left = [shown[:1]], fit - min(wide[shown[0]], most) if shown else fit
    room = left
    for column in shown[1:]:
        if room < wide[column] + _GAP and len(tables[-1]) > 1:
            tables.append(shown[:1])
            room = left
        tables[-1].append(column)
        room -= wide[column] + _GAP
    return tables
