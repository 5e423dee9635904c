"""What became of the samples of a run that lasts, by the count of its record (`hil.records.summary`).

What the board says of late answers in the end is not known yet: as in a record where it said nothing, every answer that
was not in time counts as late.
"""

from typing import Any

import numpy as np
import numpy.typing as npt

from hil.service.telemetry.views import Track
from hil.wire.messages import SenseFlags

_RECENT = 1 << 13  # answers among which that to a sample is looked for


class Deadlines:
    """Told what came at each look.

    Attributes:
        late: samples whose answer reached the board after its effective tick.
        held: rows at which the board held its drive for want of one.
        in_time: share of the samples, of which it is known, that were answered in time; None before it is.
    """

    def __init__(self) -> None:
        self.late = self.held = 0
        self._samples = self._waiting = 0  # that were counted; of these: whose answer's fate is not known yet
        self._missed: npt.NDArray[np.int64] = np.empty(0, np.int64)  # force mode: samples that had none in time
        self._in_time = 0  # gain mode
        self._gain_mode = False

    def look(self, capture: Track | None, timing: Track | None) -> None:
        """Count what the tracks' last look brought."""
        if capture is not None and len(rows := capture.new):
            self._samples += len(rows)
            held = rows["tick"][(rows["flags"] & SenseFlags.HELD) != 0]
            self.held += len(held)
            latency = int(capture.layout.header["identity"]["latency_ticks"])
            self._missed = np.concatenate([self._missed, held - latency - 1])
        if timing is None:
            return
        if "block" in timing.layout.header:
            self._ledger(timing, capture)
        else:
            self._answers(timing)

    @property
    def in_time(self) -> float | None:
        known = self._samples - self._waiting
        if known <= 0:
            return None
        in_time = self._in_time if self._gain_mode else known - self.held
        return min(max(in_time / known, 0.0), 1.0)

    def told(self) -> dict[str, Any]:
        share = self.in_time
        return {"held": self.held, "late": self.late} | ({} if share is None else {"in_time": share})

    def _ledger(self, timing: Track, capture: Track | None) -> None:
        """Gain mode: a matrix answers each sample of its block."""
        rows, header = timing.new, timing.layout.header
        self._gain_mode = True
        block = int(header["block"])
        used = rows["tick"] + (1 if header.get("deadline_us") is None else block)
        in_time = int(np.count_nonzero(rows["applied_tick"] == used))
        self._in_time += block * in_time
        self.late += block * (len(rows) - in_time)
        newest = timing.kept.newest(1)["tick"]
        last = None if capture is None else capture.kept.newest(1)["tick"]
        if last is not None and len(last) and len(newest):
            self._waiting = max(int(last[0]) - int(newest[0]), 0)

    def _answers(self, timing: Track) -> None:
        """Force mode: a sample that had no answer in time was answered late, or not at all."""
        sent = timing.kept.newest(_RECENT)["tick"]
        if not len(sent):
            return
        settled = self._missed <= sent[-1]
        self.late += int(np.isin(self._missed[settled], sent).sum())
        self._missed = self._missed[~settled]
