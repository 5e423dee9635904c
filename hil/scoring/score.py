"""Estimates beside the truth. The only reader of a truth file, and only after the run.

Sign and zero, as everywhere in the bench: the reported angle φ is +∫Ω dt, the pattern angle θ of the ellipse
in the board's frame runs the other way, θ = −φ + constant. Angles are compared after subtracting the
difference at the first scored instant, since neither φ nor ∫Ω has a natural zero there.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil.errors import InputError
from hil.numbers import SD_95
from hil.records.estimates import Estimates
from hil.records.result import OnBoard, Result, Score, save_result
from hil.records.runfolder import RunFolder
from hil.records.summary import on_board, parameters, reporting_mass_kg, summarise
from hil.records.table import Table
from hil.records.truth import Truth, read_truth
from hil.scoring.nees import NAMED, nees, outside
from hil.verdict import judge_again

Floats = npt.NDArray[np.float64]

_PATTERN_STATES = ("x_m", "vx_mps", "y_m", "vy_mps")
_SLOPE_NEEDS_RAD = 0.5
_CUT = "cut off: its end marker is missing"


class Window(NamedTuple):
    """Instants scored: bench time (n,), and their rows in the estimates and in the truth."""

    t_s: Floats
    estimated: npt.NDArray[np.intp]
    true: npt.NDArray[np.intp]


@np.errstate(all="ignore")  # an observer that diverged is told by its figures, not by NumPy
def score(run: Path, truth_file: Path) -> Result:
    """Compare the run in folder `run` with `truth_file`, write the figures into its result.json, return them.

    Scored are the instants that estimates and truth share, from the bench file's `[loop] settle_s` on.
    Filled in are `angle_error_rms_rad`, `rate_error_rms_rad_s`, the truth of each parameter, and `score`; the verdict's
    part on the angle is judged once more, now that its error is known. A run that was killed before it wrote
    result.json gets one. Raises InputError when the truth is that of another run or ends before this one does, or the
    two have nothing to compare. Of a run that was interrupted, as its board may have been, the truth may end early: a
    remark says so.
    """
    folder = RunFolder.open(run)
    truth = truth_in(truth_file)
    if folder.estimates is None:
        raise InputError(f"{folder.estimates_path}: not there; replay the capture first")
    if folder.capture is not None and folder.capture.carrier_Hz is not None:
        truth = truth.on(folder.estimates.tick_rate_Hz, truth_file)
    remarks = require_same_run(folder, truth, truth_file)
    before = folder.result or summarise(folder)
    last_s = folder.estimates.ends[1] / folder.estimates.tick_rate_Hz if len(folder.estimates) else 0.0
    if last_s < folder.scored_from_s:
        raise InputError(
            f"{run}: ended after {last_s:.3g} s, before settle_s = {folder.settle_s:g} s of it: nothing is scored; "
            f"see in {folder.report_path} why it ended, and run again"
        )
    found = compare(folder.estimates, truth, folder.scored_from_s)
    interrupted = not folder.estimates.complete or before.verdict == "interrupted"
    remarks += require_reach(truth, truth_file, folder.estimates, partly=interrupted and found is not None)
    remarks += [f"{name}: {cut}" for name, cut in folder.cut.items() if cut not in before.reasons]
    if found is None:
        raise InputError(
            f"{truth_file}: fewer than two instants in common with {folder.estimates_path} "
            f"after settle_s = {folder.settle_s:g} s; give the truth of this run, or a smaller settle_s"
        )
    covariance = folder.covariance
    honesty = None if covariance is None else nees(covariance, folder.estimates, truth, folder.scored_from_s)
    remarks += [] if honesty is None else outside(honesty)
    figures = found.figures()
    told = _with_deviation(figures.coverage, folder.estimates)
    figures = figures.model_copy(update={"nees": honesty, "coverage": told})
    if not _reaches(truth, folder.estimates):
        figures = figures.model_copy(update={"angle_error_end_rad": None})
    mass_kg = reporting_mass_kg(folder)
    effects = folder.bench.get("effects", {}).keys()
    stale = (_CUT, "the record was interrupted", NAMED)  # of another truth, of records that are whole again
    kept = (one for one in before.remarks if one not in remarks and not any(words in one for words in stale))
    result = before.model_copy(
        update={
            "angle_error_rms_rad": found.angle.rms,
            "rate_error_rms_rad_s": found.rate.rms,
            "parameters": parameters(folder.estimates, mass_kg=mass_kg, truth=truth, effects=effects),
            "score": figures,
            "board": _scored_board(folder, truth),
            "remarks": (*kept, *remarks),
        }
    )
    result = judge_again(folder, result)
    save_result(folder.result_path, result)
    return result


def _scored_board(folder: RunFolder, truth: Truth) -> OnBoard | None:
    """The board's own estimates beside the truth; what it gives no deviation for has no coverage."""
    found, board = on_board(folder), folder.board_estimates
    if found is None or board is None or (beside := compare(board, truth, folder.scored_from_s)) is None:
        return found
    figures = beside.figures()
    told = _with_deviation(figures.coverage, board)
    return found.model_copy(
        update={
            "angle_error_rms_rad": beside.angle.rms,
            "rate_error_rms_rad_s": beside.rate.rms,
            "score": figures.model_copy(update={"coverage": told}),
        }
    )


def _with_deviation(coverage: Mapping[str, float], estimates: Estimates) -> dict[str, float]:
    """The coverage of what deviations are told of."""
    return {name: share for name, share in coverage.items() if np.nan_to_num(estimates.sd(name)).any()}


def truth_in(file: Path) -> Truth:
    """The truth that something is held against. Raises InputError for a file that is none, or has no row."""
    truth = read_truth(file)
    if not len(truth):
        raise InputError(f"{file}: a truth without a row, cut off before its first block ended; give the whole file")
    return truth


def require_same_run(folder: RunFolder, truth: Truth, place: Path) -> list[str]:
    """InputError unless the codes that the board sent are those that were captured; remarks where that cannot be told.

    A truth holds the codes of its rows: sense and drive of two runs differ as soon as anything in them does.
    """
    capture = folder.capture
    if capture is None or not truth.codes or not all(name in capture.columns for name in truth.codes):
        what = "the truth" if not truth.codes else "the run"
        return [f"whether the truth is that of this run cannot be told: {what} has no codes to compare"]
    shared = 0
    for piece in capture.pieces():
        tick = piece.tick
        part = truth.between(int(tick[0]), int(tick[-1]))
        captured, true = part.at(tick)
        for name in part.codes:
            differ = np.flatnonzero(piece.columns[name][captured] != part[name][true])
            if differ.size:
                raise InputError(
                    f"{place}: of another run: at tick {tick[captured[differ[0]]]} its {name} is not the one in "
                    f"{folder.capture_path}; give the truth that this run wrote"
                )
        shared += captured.size
    if not shared:
        raise InputError(
            f"{place}: fewer than two instants in common with {folder.capture_path}; give the truth of this run"
        )
    return []


def require_reach(truth: Truth, place: Path, record: Table, *, partly: bool = False) -> list[str]:
    """InputError where the truth ends before the record does, as nobody would know what of a figure is missing; remarks
    where `partly` lets it, or where it was cut and reaches to the end all the same.
    """
    cut = "" if truth.complete else f", {_CUT}"
    ends, last = truth.ends[1], record.ends[1]
    if _reaches(truth, record):
        return [f"{place}: {_CUT}; it covers the whole run"] if cut else []
    told = (
        f"{place}: ends at {ends / record.tick_rate_Hz:.4g} s{cut}, and the run at {last / record.tick_rate_Hz:.4g} s"
    )
    if not partly:
        raise InputError(f"{told}; give the whole truth of this run")
    return [f"{told}; scored is what it covers"]


def _reaches(truth: Truth, record: Table) -> bool:
    """Whether the truth goes to the end of the record, but for less than it leaves out between two rows."""
    return bool(record.ends[1] - truth.ends[1] < truth.spacing)


def scored_window(estimates: Estimates, truth: Truth, settle_s: float) -> Window:
    """Instants in both records at or after `settle_s`."""
    estimated, true = truth.at(estimates.tick)
    scored = estimates.t_s[estimated] >= settle_s
    return Window(estimates.t_s[estimated[scored]], estimated[scored], true[scored])


class Running:
    """An error (n,) that comes in parts; `zeroed` counts it from its first value. None where a model has none."""

    def __init__(self, *, zeroed: bool = False) -> None:
        self._zeroed = zeroed
        self._first: float | None = None
        self._squares, self._largest, self._last, self._count = 0.0, 0.0, 0.0, 0

    def add(self, values: Floats | None) -> Floats | None:
        """Take the next part; returns it, counted from the first value where that is asked for."""
        if values is None or not values.size:
            return values
        if self._first is None:
            self._first = float(values[0]) if self._zeroed else 0.0
        counted: Floats = values - self._first
        self._count += values.size
        self._squares += float(np.sum(counted**2))
        self._largest = float(np.fmax(self._largest, np.abs(counted).max()))
        self._last = float(np.abs(counted[-1]))
        return counted

    @property
    def rms(self) -> float | None:
        """Root mean square; None of nothing, or when a value is not finite."""
        return math.sqrt(self._squares / self._count) if self._count and math.isfinite(self._squares) else None

    @property
    def largest(self) -> float | None:
        """Largest magnitude, likewise."""
        return self._largest if self.rms is not None else None

    @property
    def last(self) -> float | None:
        """The last magnitude, likewise."""
        return self._last if self.rms is not None else None


class Slope:
    """Least-squares slope of one quantity over another, from parts: sums about the first values."""

    def __init__(self) -> None:
        self._sums = np.zeros(5)  # of 1, x, x², y, xy
        self._origin: float | None = None
        self._low, self._high = math.inf, -math.inf

    def add(self, x: Floats, y: Floats) -> None:
        """Take the next part, both (n,)."""
        if self._origin is None:
            self._origin = float(x[0])
        self._low, self._high = min(self._low, float(x.min())), max(self._high, float(x.max()))
        x = x - self._origin
        self._sums += np.array([x.size, x.sum(), x @ x, y.sum(), x @ y])

    def over(self, needs: float) -> float | None:
        """The slope; None when x spans less than it `needs`, or a value is not finite."""
        n, x, xx, y, xy = self._sums
        if not np.isfinite(self._sums).all() or self._high - self._low < needs:
            return None
        return float((xy - x * y / n) / (xx - x * x / n))


class Comparison:
    """Estimates beside the truth, gathered window after window."""

    def __init__(self) -> None:
        self.angle, self.rate = Running(zeroed=True), Running()
        self._pattern, self._estimation, self._control = Running(zeroed=True), Running(), Running()
        self._slope = Slope()
        self._since: float | None = None
        self._until = 0.0
        self._estimation_since: float | None = None
        self._rotation: float | None = None
        self._turned = 0.0
        self._held: dict[str, int] = {}
        self.rows = 0

    def add(self, estimates: Estimates, truth: Truth, window: Window) -> None:
        if self._since is None:
            self._since = float(window.t_s[0])
        self._until = float(window.t_s[-1])
        self.rows += window.t_s.size
        angle = self.angle.add(_angle_difference_rad(estimates, truth, window))
        self.rate.add(rate_error_rad_s(estimates, truth, window))
        pattern = self._pattern.add(_angle_difference_rad(estimates, truth, window, "angle_pattern_rad"))
        estimation = self._estimation.add(estimation_error_rad(estimates, truth, window))
        if pattern is not None and estimation is not None:
            if self._estimation_since is None:
                self._estimation_since = float(estimation[0])
            self._control.add(pattern - (estimation - self._estimation_since))
        rotation = truth["angle_rad"][window.true]
        before = rotation[0] if self._rotation is None else self._rotation
        self._turned += float(np.abs(np.diff(rotation, prepend=before)).sum())
        self._rotation = float(rotation[-1])
        if angle is not None:
            self._slope.add(rotation, angle)
        for name, held in _held(estimates, truth, window).items():
            self._held[name] = self._held.get(name, 0) + held

    def figures(self) -> Score:
        """All figures of `Score`; null where the model has no such quantity."""
        slope = None if self.angle.rms is None else self._slope.over(_SLOPE_NEEDS_RAD)
        return Score(
            window_s=(self._since or 0.0, self._until),
            rows=self.rows,
            turns=self._turned / (2 * np.pi),
            angle_per_rotation=None if slope is None else 1.0 + slope,
            angle_error_max_rad=self.angle.largest,
            angle_error_end_rad=self.angle.last,
            rate_error_max_rad_s=self.rate.largest,
            pattern_angle_error_rms_rad=self._pattern.rms,
            angle_estimation_error_rms_rad=self._estimation.rms,
            control_imperfection_rms_rad=self._control.rms,
            coverage={name: held / self.rows for name, held in self._held.items()},
        )


@np.errstate(all="ignore")  # an observer that diverged is told by its figures, not by NumPy
def compare(estimates: Estimates, truth: Truth, settle_s: float) -> Comparison | None:
    """All figures over the instants in both records from `settle_s` on; None when there are fewer than two.

    Goes through the records part by part: neither is in memory as a whole.
    """
    found = Comparison()
    for _, piece, part in truth.beside(estimates):
        window = scored_window(piece, part, settle_s)
        if window.t_s.size:
            found.add(piece, part, window)
    return found if found.rows > 1 else None


def angle_error_rad(estimates: Estimates, truth: Truth, window: Window, column: str = "angle_rad") -> Floats | None:
    """An estimated angle minus ∫Ω dt (n,), zero at the first scored instant. None where there is none."""
    error = _angle_difference_rad(estimates, truth, window, column)
    return None if error is None else np.asarray(error - error[0])


def _angle_difference_rad(
    estimates: Estimates, truth: Truth, window: Window, column: str = "angle_rad"
) -> Floats | None:
    if column not in estimates:
        return None
    difference: Floats = estimates[column][window.estimated] - truth["angle_rad"][window.true]
    return difference


def rate_error_rad_s(estimates: Estimates, truth: Truth, window: Window) -> Floats | None:
    """Estimated minus true rate (n,). None for a model without a rate."""
    if "rate_rad_s" not in estimates:
        return None
    error: Floats = estimates["rate_rad_s"][window.estimated] - truth["rate_rad_s"][window.true]
    return error


def estimation_error_rad(estimates: Estimates, truth: Truth, window: Window) -> Floats | None:
    """What the observer contributes to the pattern angle (n,), in the sign of φ.

    The pattern angle of the estimated state minus that of the true state by one and the same formula, negated
    (φ = −θ), and reduced to ±π/2 since a pattern angle is known modulo π. The rest of the pattern's error is
    control imperfection: the true pattern does not turn exactly with −∫Ω dt. None for a single axis.
    """
    if not all(name in estimates and name in truth.columns for name in _PATTERN_STATES):
        return None
    stiffness = _stiffness_per_s2(estimates, truth)
    angular_gain = float(estimates.header.get("angular_gain", 1.0))
    spin = _virtual_rad_s(estimates, window) + angular_gain * truth["rate_rad_s"][window.true]
    estimated_state = np.stack([estimates[name][window.estimated] for name in _PATTERN_STATES])
    true_state = np.stack([truth[name][window.true] for name in _PATTERN_STATES])
    estimated = pattern_angle_rad(estimated_state, stiffness, spin)
    true = pattern_angle_rad(true_state, stiffness, spin)
    return -((estimated - true + np.pi / 2) % np.pi - np.pi / 2) / angular_gain


def _virtual_rad_s(estimates: Estimates, window: Window) -> Floats:
    """Virtual rotation (n,) at the scored instants; with reversals the first comes after half of their interval."""
    imposed = float(estimates.header.get("virtual_rotation_rad_s", 0.0))
    period = float(estimates.header.get("virtual_reversal_s", 0.0))
    if period == 0.0:
        return np.full(window.t_s.size, imposed)
    return np.where(np.round(window.t_s / period) % 2 == 1, -imposed, imposed)


def pattern_angle_rad(state: Floats, stiffness_per_s2: float, spin_rad_s: Floats) -> Floats:
    """Orientation of the vibration ellipse (n,) in (−π/2, π/2]: equation (11), Friedland & Hutton 1978.

    `state` (4, n) holds x, ẋ, y, ẏ in SI. The velocities are taken out of the frame that turns at
    `spin_rad_s` (ẋ − W y, ẏ + W x, k + W²), which makes the formula exact for a rotating isotropic
    oscillator. Kept apart from the estimator's own: a judge shares no code with the judged.
    """
    x, vx, y, vy = state
    k = stiffness_per_s2 + spin_rad_s**2
    wx, wy = vx - spin_rad_s * y, vy + spin_rad_s * x
    theta: Floats = 0.5 * np.arctan2(2 * (k * x * y + wx * wy), k * (x**2 - y**2) + wx**2 - wy**2)
    return theta


def _held(estimates: Estimates, truth: Truth, window: Window) -> dict[str, int]:
    """For each state with a known truth, how many scored instants lie within ± 1.96 standard deviations.

    Instants of one run are correlated: this tells an honest interval from a wrong one, not 94 % from 96 %.
    """
    found: dict[str, int] = {}
    for name in estimates.states:
        if name in truth.constants:
            true: Floats = np.full(window.t_s.size, truth.constants[name])
        elif name in truth.columns:
            true = truth[name][window.true]
        else:
            continue
        error = np.abs(estimates[name][window.estimated] - true)
        found[name] = int(np.count_nonzero(error <= SD_95 * estimates.sd(name)[window.estimated]))
    return found


def _stiffness_per_s2(estimates: Estimates, truth: Truth) -> float:
    """The target stiffness the loop was told to make, or else the mean of the true ones."""
    stated = estimates.header.get("target_stiffness_per_s2")
    return float(stated) if stated else float(np.mean(truth.header["stiffness_per_s2"][:2]))
