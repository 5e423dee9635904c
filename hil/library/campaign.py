"""A campaign that was carried out, as an object."""

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from hil.errors import InputError
from hil.progress import Watcher
from hil.records.atomic import write_text
from hil.sweeping.plan import Plan

if TYPE_CHECKING:
    import pandas
    import pyarrow

    from hil.sweeping.baseline import Change
    from hil.sweeping.dependence import Dependence
    from hil.sweeping.ensemble import Worst
    from hil.sweeping.request import CampaignRequest


class Sweep:
    """The results of a campaign in a folder. What is large is read when asked for.

    Attributes:
        made, seconds: how many of its runs were made just now, and in how long.
        changes: what became of each figure since the baseline that was given; none without one.
        uncompared: what the baseline lacks of it, a sentence each.
    """

    def __init__(self, plan: Plan, folder: Path, made: int = 0, seconds: float = 0.0) -> None:
        self.changes: list[Change] = []
        self.uncompared: list[str] = []
        self._plan = plan
        self._folder = folder
        self.made, self.seconds = made, seconds

    @property
    def path(self) -> Path:
        """Its folder: campaign.json, results/, report.html."""
        return self._folder

    @cached_property
    def table(self) -> "pyarrow.Table":
        """A row a run, in their order: its keys, its figures (docs/reference/campaigns.md)."""
        from hil.sweeping.columns import schema
        from hil.sweeping.kept import read_rows

        return read_rows(self._folder, schema(self._plan.campaign))

    def to_pandas(self) -> "pandas.DataFrame":
        """The table as a frame over the number of the run."""
        return self.table.to_pandas().set_index("run")

    @cached_property
    def worst(self) -> "list[Worst]":
        """The runs that came out worst, each with the command that makes it again."""
        from hil.sweeping.ensemble import worst_of

        report = self._plan.campaign.report
        return worst_of(self.table, report.figure, report.worst, self._plan.called)

    @cached_property
    def dependence(self) -> "Dependence | None":
        """Which keys the figure of [report] depends on; None where nothing is varied or nothing differs."""
        return self.dependence_of(self._plan.campaign.report.figure)

    @property
    def worse(self) -> "list[Change]":
        """The figures that got worse beyond their intervals."""
        return [one for one in self.changes if one.worse]

    def dependence_of(self, figure: str) -> "Dependence | None":
        """The same of another column of numbers.  Raises InputError where there is none of that name."""
        from hil.sweeping.dependence import dependence
        from hil.toml.reading import suggestion

        if figure not in self.table.column_names:
            raise InputError(f"{figure}: no such column; {suggestion(figure, self.table.column_names)}")
        return dependence(self._plan, self.table, figure)

    def report(self) -> Path:
        """The page of the campaign, report.html; written where it is missing."""
        path = self._folder / "report.html"
        if not path.exists():
            from hil.sweeping.page import write_report

            write_report(self._plan, self._folder, self.table)
        return path

    def __repr__(self) -> str:
        return f"<Sweep {self._folder}: {len(self.table)} of {len(self._plan)} runs>"


def carried_out(request: "CampaignRequest", progress: Watcher) -> Sweep:
    """Make what the folder lacks; a page of what was there before is taken away.  Raises as `hil.sweep`, and `Stopped`
    on Ctrl-C.
    """
    from hil.sweeping.sweep import sweep

    done = sweep(
        request.plan,
        request.folder,
        workers=request.workers,
        scheduler=request.scheduler,
        arm=request.arm,
        progress=progress,
    )  # fmt: skip
    if done.made:
        (request.folder / "report.html").unlink(missing_ok=True)
    swept = Sweep(request.plan, request.folder, done.made, done.seconds)
    if request.baseline is not None:
        from hil.sweeping.baseline import as_junit, changes, uncompared

        swept.changes = changes(swept.table, request.baseline, request.plan.campaign)
        swept.uncompared = uncompared(swept.table, request.baseline, request.plan.campaign)
        if request.junit is not None:
            write_text(request.junit, as_junit(swept.changes, request.plan.campaign.name))
    return swept
