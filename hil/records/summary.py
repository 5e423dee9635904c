"""The figures that a run folder's records give by themselves, without any truth.

What became of each sample of a run: one count, whose parts add up to the ticks of the run.

`docs/reference/run-folder.md` (What became of each sample) has the parts in words. An answer is a row of
`timing.arrow`: in force mode to one sample, in gain mode to the block of samples that ends at its tick. What the record
shows of an answer stands at its telltale: in force mode the row after the interval that begins at the answer's
effective tick, flagged where the board held an old drive; in gain mode the effective tick itself, from which the matrix
was used or not.
"""

import math
from collections.abc import Collection, Iterable, Mapping

import numpy as np
import numpy.typing as npt

from hil.numbers import SD_95, finite
from hil.records.capture import TIME_LOCKSTEP, Capture, RowFlag
from hil.records.clock import ClockRecord
from hil.records.estimates import Estimates, Innovation, steady, usual_sd_V
from hil.records.quantiles import quantiles
from hil.records.rate_reference import errors
from hil.records.result import (
    Answers,
    BoardClock,
    ClockRelation,
    Constant,
    Ledger,
    OnBoard,
    Percentiles,
    Result,
    SampleRate,
)
from hil.records.runfolder import RunFolder
from hil.records.timing import Timing, rate_of_ticks
from hil.records.truth import Truth
from hil.records.units import symbol_of

_ONE_CLOCK = "in lockstep the board's time stops until the host answers"
_NOT_ASKED = "nobody asked the board for its time"
_LEDGER_ROWS, _STRETCHES = 1 << 20, 16
_BACK_ROWS = 4096
_MOVING = ("x_m", "vx_mps", "y_m", "vy_mps", "rate_rad_s")
_PER_MASS = {"1/s²": "N/m", "1/s": "N·s/m"}


@np.errstate(all="ignore")  # an observer that diverged is told by its figures, not by NumPy
def summarise(folder: RunFolder, counters: Mapping[str, int] | None = None) -> Result:
    """Figures of a run from its files: counts, parameters at the end, innovation, turnaround.

    Whatever file is missing leaves its figures null. An existing result.json is not looked at. `counters` are the
    loop's and the board's own.
    """
    capture, estimates, innovation, timing = (
        folder.capture,
        folder.estimates,
        folder.innovation,
        folder.timing,
    )
    counted = answers(capture, timing, counters or {})
    beside = errors(capture, estimates, folder.scored_from_s)
    return Result(
        run=folder.path.resolve().name,
        seconds=_seconds(capture, estimates),
        samples=0 if capture is None else len(capture),
        lost=0 if capture is None else capture.lost,
        late=0 if counted is None else counted.late,
        answers=counted,
        angle_error_rms_rad=beside.angle_rms_rad,
        rate_error_rms_rad_s=beside.rate_rms_rad_s,
        parameters={} if estimates is None else parameters(estimates, mass_kg=reporting_mass_kg(folder)),
        sense_unit="V" if innovation is None else innovation.unit,
        innovation_rms=None if innovation is None else innovation_rms(innovation, folder.scored_from_s),
        noise_floor=None if innovation is None else predicted_rms(innovation, folder.scored_from_s),
        turnaround_us=None if timing is None else turnaround(timing),
        ledger_us=None if timing is None else ledger(timing, capture, folder.clock),
        board=on_board(folder),
        complete=capture is not None and capture.complete,
    )


def answers(capture: Capture | None, timing: Timing | None, counters: Mapping[str, int]) -> Answers | None:
    """What became of each sample; None where no board was answered."""
    if capture is None or timing is None or "identity" not in capture.header:
        return None
    return count_answers(
        ((piece.tick, piece.flags) for piece in capture.pieces()),
        timing,
        capture.latency_ticks,
        stopped=counters.get("stopped", 0),
        board_late=counters.get("board_late"),
    )


def parameters(
    estimates: Estimates, *, mass_kg: float | None = None, truth: Truth | None = None, effects: Collection[str] = ()
) -> dict[str, Constant]:
    """Constants and offsets at the last estimate, with value ± 1.96 standard deviations where the observer gives them;
    `effects`: those in the model.

    An estimate that diverged (not finite) is left out. Per unit mass, or with `mass_kg` in N/m and N·s/m.
    The truth of an offset is its value at the last common instant, since offsets may drift.
    """
    if not len(estimates):
        return {}
    last = estimates.part(len(estimates) - 1, len(estimates))
    table: dict[str, Constant] = {}
    for name in estimates.states:
        if name in _MOVING:
            continue
        unit = estimates.unit(name)
        factor = mass_kg if mass_kg is not None and unit in _PER_MASS else 1.0
        value, spread = float(last[name][0]), SD_95 * float(last.sd(name)[0])
        if not math.isfinite(value) or math.isinf(spread):
            continue
        true = None if truth is None else _true_value(name, estimates, truth, effects)
        table[symbol_of(name)] = Constant(
            value=factor * value,
            ci95=(factor * (value - spread), factor * (value + spread)) if spread > 0.0 else None,
            unit=unit if factor is not mass_kg else _PER_MASS[unit],
            truth=None if true is None else factor * true,
            declared=spread == 0.0,
        )
    return table


def innovation_rms(innovation: Innovation, settle_s: float) -> float | None:
    """Root mean square over all axes from `settle_s` on, of the rows whose prediction is as sure as usual:
    what comes right behind a gap is no residual. None where there are none, or one is not finite.
    """
    scored = innovation.since(settle_s)
    if (usual := usual_sd_V(scored)) is None:
        return None
    count, squares = 0, 0.0
    for piece in scored.pieces():
        nu = piece.nu_V[steady(piece.sd_V, usual)]
        count += nu.size
        squares += float(np.sum(nu**2))
    return math.sqrt(squares / count) if count and math.isfinite(squares) else None


def predicted_rms(innovation: Innovation, settle_s: float) -> float | None:
    """What `innovation_rms` would be for a complete model: the predicted standard deviation, as the median."""
    usual = usual_sd_V(innovation.since(settle_s))
    return None if usual is None else float(np.sqrt(np.mean(usual**2)))


def percentiles(times_us: npt.NDArray[np.float64]) -> Percentiles | None:
    """p50, p99 and p99.9 of a set of times; None of an empty one."""
    if not times_us.size:
        return None
    p50, p99, p999 = (float(value) for value in np.percentile(times_us, (50.0, 99.0, 99.9)))
    return Percentiles(p50=p50, p99=p99, p999=p999)


def turnaround(timing: Timing) -> Percentiles | None:
    """Percentiles of the time from a sample's arrival to its answer's departure."""
    found = quantiles(lambda: (piece.turnaround_us for piece in timing.pieces()), (0.5, 0.99, 0.999))
    return None if found is None else Percentiles(p50=found[0], p99=found[1], p999=found[2])


def ledger(timing: Timing, capture: Capture | None, clock: ClockRecord | None) -> Ledger | None:
    """Percentiles of each stage of the blocks; None in lockstep, and where nothing tells when answers acted.

    Of a very long record a million blocks stand for all, in stretches spread over it.
    """
    timing = timing.spread(_LEDGER_ROWS, _STRETCHES)
    applied = timing.applied
    if applied is None and capture is not None and timing.deadline_us is not None:
        applied = np.concatenate([applied_ticks(part.tick, capture) for part in timing.stretches()])
    stages = {} if applied is None else timing.ledger_us(applied, clock)
    if not stages:
        return None
    # A block that was applied before it could have been known on its clock is noise of that clock.
    found = {name: percentiles(np.maximum(elapsed, 0.0)) for name, elapsed in stages.items()}
    return Ledger.model_validate({name: value for name, value in found.items() if value is not None})


def applied_ticks(tick: npt.NDArray[np.int64], capture: Capture) -> npt.NDArray[np.int64]:
    """Force mode: the tick from which the answer to each tick (n,) acted, -1 where it did not in time or nobody knows.

    The row after it tells: it carries the drive held since, and a flag where that was an old one.
    """
    effective = tick + capture.latency_ticks
    if tick.size:
        capture = capture.between(int(effective.min()), int(effective.max()) + 1)
    told = capture.tick[(capture.flags & RowFlag.LATE_ANSWER_HELD) == 0]
    return np.where(np.isin(effective + 1, told), effective, -1)


def board_clock(folder: RunFolder) -> BoardClock | None:
    """What the times of a recorded run are on; None without a capture that says so."""
    capture, clock = folder.capture, folder.clock
    if capture is None or "time" not in capture.header:
        return None
    base = str(capture.header["time"])
    if clock is None:
        return BoardClock(time_base=base, unknown=_ONE_CLOCK if base == TIME_LOCKSTEP else _NOT_ASKED)
    fit, rate = clock.fit, sample_rate(capture, clock, folder.timing)
    if fit is None:
        return BoardClock(time_base=base, sample_rate=rate, unknown=clock.unknown)
    relation = ClockRelation(
        at_host_ns=fit.at_host_ns,
        offset_ns=fit.offset_ns,
        offset_uncertainty_ns=fit.offset_uncertainty_ns,
        skew_ppm=1e6 * fit.skew,
        skew_uncertainty_ppm=1e6 * fit.skew_ci,
        skew_bound_ppm=1e6 * fit.skew_bound,
        round_trip_us=1e-3 * fit.round_trip_ns,
        exchanges=fit.exchanges,
        used=fit.used,
    )
    return BoardClock(time_base=base, relation=relation, sample_rate=rate)


def sample_rate(capture: Capture, clock: ClockRecord, timing: Timing | None) -> SampleRate | None:
    """From when the host had which tick: of a sample that it answered, or in board mode the one in an exchange of time
    while the board streamed.
    """
    if timing is not None:
        known = timing.spread(_LEDGER_ROWS, _STRETCHES)
        ticks, host_ns = known.tick, known.columns["t_receive_ns"]
    else:
        first, last = capture.ends if len(capture) else (0, 0)
        streaming = (clock.tick > first) & (clock.tick < last)  # one that stands still says the same tick
        ticks, host_ns = clock.tick[streaming], clock.columns["t_receive_ns"][streaming]
    declared_Hz = clock.tick_rate_Hz
    if (found := rate_of_ticks(ticks, host_ns, declared_Hz)) is None:
        return None
    off, half = found
    return SampleRate(
        declared_Hz=declared_Hz, measured_Hz=declared_Hz * (1.0 + off), off_ppm=1e6 * off, uncertainty_ppm=1e6 * half
    )


def reporting_mass_kg(folder: RunFolder) -> float | None:
    """The mass to multiply by, when the bench file asks for unnormalised parameters; else None."""
    device = folder.bench.get("device", {})
    return float(device["mass_kg"]) if device.get("normalised") is False and "mass_kg" in device else None


def _seconds(capture: Capture | None, estimates: Estimates | None) -> float:
    record = capture if capture is not None else estimates
    if record is None or not len(record):
        return 0.0
    first_s, last_s = record.ends_s
    return last_s - first_s


def _true_value(name: str, estimates: Estimates, truth: Truth, effects: Collection[str]) -> float | None:
    constants = truth.constants | truth.coefficients(effects)
    if name in constants:
        return constants[name]
    if name not in truth.columns:
        return None
    for start in range(len(estimates) - 1, -1, -_BACK_ROWS):  # the last instant that both have is near the end
        tick = estimates.part(max(start - _BACK_ROWS + 1, 0), start + 1).tick
        part = truth.between(int(tick[0]), int(tick[-1]))
        _, ours = part.at(tick)
        if ours.size:
            return float(part[name][ours[-1]])
    return None


Ticks = npt.NDArray[np.int64]


def count_answers(
    rows: Iterable[tuple[Ticks, npt.NDArray[np.uint8]]],
    timing: Timing,
    latency_ticks: int,
    *,
    stopped: int = 0,
    board_late: int | None = None,
) -> Answers | None:
    """The count of a run; None where nothing was recorded, or in gain mode the record is too old to tell.

    Args:
        rows: ticks (n,) and flags (n,) of the capture, in pieces of any size, in their order.
        timing: the answers that were sent.
        latency_ticks: from a sample to the interval that its answer acts on.
        stopped: ticks of the gaps in which the board was SAFE, by the loop's own count.
        board_late: answers that the board says came too late, in this run; None where it said nothing.
    """
    gain_mode = _has_ledger(timing)
    block = int(timing.header.get("block", 0)) if gain_mode else 1
    if not block:
        return None
    used_after = (block if timing.deadline_us is not None else 1) if gain_mode else latency_ticks + 1
    window = _Window(timing, used_after)
    first = last = None
    recorded = 0
    for tick, flags in rows:
        if not tick.size:
            continue
        first, last = int(tick[0]) if first is None else first, int(tick[-1])
        recorded += tick.size
        window.reach(last)
        answer, found = _answer_to(tick, window.sent, block)
        window.size += np.bincount(answer[found], minlength=window.sent.size)
        if window.applied is not None:
            used = window.sent + used_after  # first tick computed with it
            seen = np.isin(used, tick, assume_unique=True)
            window.missed |= seen & (window.applied != used)
        else:
            held = tick[(flags & RowFlag.LATE_ANSWER_HELD) != 0]
            answer, found = _answer_to(held - used_after, window.sent, block)
            window.missed[answer[found]] = True
        window.settle(last)
    if first is None or last is None:
        return None
    window.settle(None)
    ticks, answered, not_in_time = last - first + 1, window.answered, window.not_in_time
    late = not_in_time if board_late is None else min(board_late * block, answered)
    lost_to_board = max(not_in_time - late, 0)
    stopped = min(stopped, ticks - recorded)
    return Answers(
        ticks=ticks,
        in_time=answered - late - lost_to_board,
        late=late,
        unanswered=recorded - answered,
        lost_to_board=lost_to_board,
        lost_to_host=ticks - recorded - stopped,
        stopped=stopped,
        slow=window.slow,
    )


class _Window:
    """The answers that the rows at hand may belong to; those before have been counted, those after are not read yet.

    Attributes:
        sent: ticks (n,) of the answers.
        applied: ticks (n,) from which they were used, in gain mode.
        size: samples (n,) that each is to, so far.
        missed: whether (n,) the record shows that it was not used in time.
        answered, not_in_time, slow: samples of the answers that have been counted.
    """

    def __init__(self, timing: Timing, telltale: int) -> None:
        self._pieces = timing.pieces()
        self._telltale = telltale
        self._deadline_us = timing.deadline_us
        self.sent: Ticks = np.empty(0, np.int64)
        self.applied: Ticks | None = np.empty(0, np.int64) if _has_ledger(timing) else None
        self.size: Ticks = np.empty(0, np.int64)
        self.missed = np.empty(0, bool)
        self._slow = np.empty(0, bool)
        self.answered = self.not_in_time = self.slow = 0

    def reach(self, tick: int) -> None:
        """Read on until there is the answer to `tick`, or no more."""
        while not self.sent.size or self.sent[-1] < tick:
            piece = next(self._pieces, None)
            if piece is None:
                return
            more = piece.tick
            self.sent = np.concatenate([self.sent, more])
            self.size = np.concatenate([self.size, np.zeros(more.size, np.int64)])
            self.missed = np.concatenate([self.missed, np.zeros(more.size, bool)])
            if self.applied is not None and piece.applied is not None:
                self.applied = np.concatenate([self.applied, piece.applied])
            slow = np.zeros(more.size, bool) if self._deadline_us is None else piece.turnaround_us > self._deadline_us
            self._slow = np.concatenate([self._slow, slow])

    def settle(self, last: int | None) -> None:
        """Count the answers that no row after `last` has anything to say of, and let them go; None: all of them."""
        done = self.sent.size if last is None else int(np.searchsorted(self.sent, last - self._telltale, "right"))
        size = self.size[:done]
        self.answered += int(size.sum())
        self.not_in_time += int(size[self.missed[:done]].sum())
        self.slow += int(size[self._slow[:done]].sum())
        self.sent, self.size = self.sent[done:], self.size[done:]
        self.missed, self._slow = self.missed[done:], self._slow[done:]
        if self.applied is not None:
            self.applied = self.applied[done:]


def _has_ledger(timing: Timing) -> bool:
    return "applied_tick" in timing.columns


def _answer_to(tick: Ticks, sent: Ticks, block: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.bool_]]:
    """Index (n,) of the answer to each of some ticks, and whether (n,) there was one."""
    answer = np.searchsorted(sent, tick)
    found: npt.NDArray[np.bool_] = answer < sent.size
    found[found] = sent[answer[found]] - tick[found] < block
    return answer, found


def on_board(folder: RunFolder) -> OnBoard | None:
    """Over the scored window, of the instants that both have and at which the board calls its angle valid; None where
    the board said none."""
    board, host = folder.board_estimates, folder.estimates
    if board is None or not len(board):
        return None
    scored = board.t_s >= folder.scored_from_s
    valid = float(np.mean(board.valid[scored])) if scored.any() else None
    found = OnBoard(rows=len(board), valid_fraction=valid)
    if host is None:
        return found
    _, ours, theirs = np.intersect1d(host.tick, board.tick, return_indices=True)
    compared = (host.t_s[ours] >= folder.scored_from_s) & board.valid[theirs]
    ours, theirs = ours[compared], theirs[compared]
    if not ours.size:
        return found
    angle = _difference(board, host, "angle_rad", theirs, ours)
    rate = _difference(board, host, "rate_rad_s", theirs, ours)
    return found.model_copy(
        update={
            "angle_difference_rms_rad": None if angle is None else _rms(angle - angle[0]),
            "angle_difference_end_rad": None if angle is None else finite(abs(angle[-1] - angle[0])),
            "rate_difference_rms_rad_s": None if rate is None else _rms(rate),
        }
    )


def _difference(
    board: Estimates, host: Estimates, name: str, theirs: np.ndarray, ours: np.ndarray
) -> np.ndarray | None:
    both = name in host and name in board
    return np.asarray(board[name][theirs] - host[name][ours], np.float64) if both else None


def _rms(values: np.ndarray) -> float | None:
    return finite(float(np.sqrt(np.mean(np.square(values)))))
