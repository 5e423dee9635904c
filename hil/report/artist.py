"""A process that draws the figures of a run while this one works out what else its page says.

Matplotlib draws for a second, and loads for half of one, behind the interpreter's lock; so it is loaded by a process of
its own, beside the run where nothing waits in real time, and the figures are drawn beside the closing scan.
"""

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from estimator.side_by_side import workers


class Artist:
    def __init__(self, process: "subprocess.Popen[str] | None") -> None:
        self._process = process

    def draw(self, folder: Path) -> None:
        """Begin with the figures of a run, whose records are whole."""
        if self._process is not None and self._process.stdin is not None:
            with suppress(BrokenPipeError):  # it has died: `drawn` finds none
                self._process.stdin.write(f"{json.dumps(str(folder))}\n")
                self._process.stdin.flush()

    def drawn(self) -> dict[str, str] | None:
        """Figures of that run as HTML, by the name of what draws them, once it is done; None where there are none."""
        if self._process is None or self._process.stdout is None:
            return None
        line = self._process.stdout.readline()
        return json.loads(line) if line.endswith("\n") else None


@contextmanager
def artist_process() -> Iterator[Artist]:
    """The process, which loads what it needs; it has ended at the end of the block.  None of its own on one
    processor.
    """
    if workers() < 2:
        yield Artist(None)
        return
    pipe = subprocess.PIPE
    command = [sys.executable, "-m", "hil.report.artist"]
    with subprocess.Popen(
        command, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, text=True, start_new_session=True
    ) as process:
        try:
            yield Artist(process)
        finally:
            process.kill()


def main() -> None:
    import matplotlib.backends.backend_svg  # before there is anything to draw
    import matplotlib.figure  # noqa: F401

    from hil.records.runfolder import RunFolder
    from hil.report.drawn import draw_figures
    from hil.report.material import Material

    if line := sys.stdin.readline():
        print(json.dumps(draw_figures(Material(RunFolder(Path(json.loads(line)))))), flush=True)


if __name__ == "__main__":
    main()
