"""Progress on standard error: a moving bar on a terminal, a line per stage elsewhere."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from hil.errors import printable
from hil.progress import Progress, Watcher, alarm


@contextmanager
def watching(title: str, *, whole: bool = False) -> Iterator[Watcher]:
    """A watcher that draws what it is told for the length of the block; an interruption that says what was done by
    then has it printed. The time left is that of the stage at hand, by its own pace, or with ``whole`` that of all
    stages, which it is told."""
    try:
        if sys.stderr.isatty():
            with _bar(title, whole=whole) as watch:
                yield watch
        else:
            yield _StageLines()
    except KeyboardInterrupt as interruption:
        if words := str(interruption):
            print(printable(words), file=sys.stderr, flush=True)
        raise


class _StageLines:
    """For pipes and log files: the name of each stage once."""

    def __init__(self) -> None:
        self._stage = ""
        self._note = ""

    def __call__(self, progress: Progress) -> None:
        if progress.alarm:
            alarm(progress.alarm)
            return
        if progress.note.startswith("waiting") and not self._note:
            self._note = progress.note
            print(printable(progress.note), file=sys.stderr, flush=True)
        if progress.stage != self._stage:
            self._stage = progress.stage
            print(printable(progress.stage), file=sys.stderr, flush=True)


@contextmanager
def _bar(title: str, *, whole: bool) -> Iterator[Watcher]:
    from rich.console import Console
    from rich.progress import BarColumn, TaskID, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bars

    from hil.tracing.time_left import in_words

    columns = (
        TextColumn(printable(title), style="dim", markup=False),
        TextColumn("{task.description}", style="bold", markup=False),
        BarColumn(),
        TextColumn("{task.fields[left]}", markup=False) if whole else TimeRemainingColumn(compact=True),
        TextColumn("{task.fields[note]}", style="dim", markup=False),
    )
    with Bars(*columns, console=Console(stderr=True, highlight=False), refresh_per_second=4, transient=True) as bars:
        shown: dict[str, TaskID] = {}  # the stage at hand: a new bar each, since a total once set would stay

        def watch(progress: Progress) -> None:
            if progress.alarm:
                line = printable(f"hil: UNSAFE: {progress.alarm}")
                bars.console.print(line, style="bold white on red", markup=False)
                return
            if progress.stage not in shown:
                for past in shown.values():
                    bars.remove_task(past)
                shown.clear()
                shown[progress.stage] = bars.add_task(printable(progress.stage), total=None, note="", left="")
            bars.update(
                shown[progress.stage],
                completed=progress.done,
                total=progress.total or None,
                note=printable(progress.note),
                left="" if progress.left_s is None else in_words(progress.left_s),
            )

        yield watch
