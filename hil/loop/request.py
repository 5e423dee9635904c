"""A run as it is asked for: bench, link, and what else the loop is told."""

from dataclasses import dataclass
from pathlib import Path

from hil.bench import Bench
from hil.boards.emulation import is_emulated


@dataclass(frozen=True)
class RunRequest:
    """The bench with what was given in the place of its keys, and the link with an emulated board's scenario as a path.

    open_loop: the drive is held at zero.  dry_run: nothing is armed, nothing recorded.  truth: file for the truth of
    an emulated board.  note: of the operator, for result.json.  wire_log: file for the frames of a CAN link.
    """

    bench: Bench
    link: str
    open_loop: bool = False
    dry_run: bool = False
    truth: Path | None = None
    note: str | None = None
    wire_log: Path | None = None

    @property
    def emulated(self) -> bool:
        """Whether the link starts its own board, where nothing real can be driven."""
        return is_emulated(self.link)
