"""Estimates beside the truth. The only reader of a truth file, and only after the run.

Sign and zero, as everywhere in the bench: the reported angle φ is +∫Ω dt, the pattern angle θ of the ellipse
in the board's frame runs the other way, θ = −φ + constant. Angles are compared after subtracting the
difference at the first scored instant, since neither φ nor ∫Ω has a natural zero there.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil.errors import InputError
from hil.records.estimates import Estimates
from hil.records.result import Result, Score, save_result
from hil.records.runfolder import RunFolder
from hil.records.summary import SD_95, parameters, reporting_mass_kg, rms, summarise
from hil.records.truth import Truth, read_truth

Floats = npt.NDArray[np.float64]

_PATTERN_STATES = ("x_m", "vx_mps", "y_m", "vy_mps")
_SLOPE_NEEDS_RAD = 0.5


class Window(NamedTuple):
    """Instants scored: bench time (n,), and their rows in the estimates and in the truth."""

    t_s: Floats
    estimated: npt.NDArray[np.intp]
    true: npt.NDArray[np.intp]


def score(run: Path, truth_file: Path) -> Result:
    """Compare the run in folder `run` with `truth_file`, write the figures into its result.json, return them.

    Scored are the instants that estimates and truth share, from the bench file's `[loop] settle_s` on.
    Filled in are `angle_error_rms_rad`, `rate_error_rms_rad_s`, the truth of each parameter, and `score`. A
    run that was killed before it wrote result.json gets one. Raises InputError when the two have nothing to
    compare.
    """
    folder = RunFolder.open(run)
    truth = read_truth(truth_file)
    if folder.estimates is None:
        raise InputError(f"{folder.estimates_path}: not there; replay the capture first")
    window = scored_window(folder.estimates, truth, folder.settle_s)
    if window.t_s.size < 2:
        raise InputError(
            f"{truth_file}: fewer than two instants in common with {folder.estimates_path} "
            f"after settle_s = {folder.settle_s:g} s; give the truth of this run, or a smaller settle_s"
        )
    figures = compare(folder.estimates, truth, window)
    mass_kg = reporting_mass_kg(folder)
    result = (folder.result or summarise(folder)).model_copy(
        update={
            "angle_error_rms_rad": _rms(angle_error_rad(folder.estimates, truth, window)),
            "rate_error_rms_rad_s": _rms(rate_error_rad_s(folder.estimates, truth, window)),
            "parameters": parameters(folder.estimates, mass_kg=mass_kg, truth=truth),
            "score": figures,
        }
    )
    save_result(folder.result_path, result)
    return result


def scored_window(estimates: Estimates, truth: Truth, settle_s: float) -> Window:
    """Instants in both records at or after `settle_s`."""
    estimated, true = truth.at(estimates.tick)
    scored = estimates.t_s[estimated] >= settle_s
    return Window(estimates.t_s[estimated[scored]], estimated[scored], true[scored])


def compare(estimates: Estimates, truth: Truth, window: Window) -> Score:
    """All figures of `Score` over the window; null where the model has no such quantity."""
    angle, rate = angle_error_rad(estimates, truth, window), rate_error_rad_s(estimates, truth, window)
    estimation = estimation_error_rad(estimates, truth, window)
    pattern = angle_error_rad(estimates, truth, window, "angle_pattern_rad")
    control = None if pattern is None or estimation is None else pattern - (estimation - estimation[0])
    rotation = truth["angle_rad"][window.true]
    return Score(
        window_s=(float(window.t_s[0]), float(window.t_s[-1])),
        rows=window.t_s.size,
        turns=float(np.abs(np.diff(rotation)).sum()) / (2 * np.pi),
        angle_per_rotation=_slope(rotation, angle),
        angle_error_max_rad=_largest(angle),
        rate_error_max_rad_s=_largest(rate),
        pattern_angle_error_rms_rad=_rms(pattern),
        angle_estimation_error_rms_rad=_rms(estimation),
        control_imperfection_rms_rad=_rms(control),
        coverage=coverage(estimates, truth, window),
    )


def angle_error_rad(estimates: Estimates, truth: Truth, window: Window, column: str = "angle_rad") -> Floats | None:
    """An estimated angle minus ∫Ω dt (n,), zero at the first scored instant. None where there is none."""
    if column not in estimates:
        return None
    error: Floats = estimates[column][window.estimated] - truth["angle_rad"][window.true]
    return np.asarray(error - error[0])


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
    spin = estimates.header.get("virtual_rotation_rad_s", 0.0) + truth["rate_rad_s"][window.true]
    estimated_state = np.stack([estimates[name][window.estimated] for name in _PATTERN_STATES])
    true_state = np.stack([truth[name][window.true] for name in _PATTERN_STATES])
    estimated = pattern_angle_rad(estimated_state, stiffness, spin)
    true = pattern_angle_rad(true_state, stiffness, spin)
    return -((estimated - true + np.pi / 2) % np.pi - np.pi / 2)


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


def coverage(estimates: Estimates, truth: Truth, window: Window) -> dict[str, float]:
    """For each state with a known truth, the fraction of scored instants within ± 1.96 standard deviations.

    Instants of one run are correlated: this tells an honest interval from a wrong one, not 94 % from 96 %.
    """
    found: dict[str, float] = {}
    for name in estimates.states:
        if name in truth.constants:
            true: Floats = np.full(window.t_s.size, truth.constants[name])
        elif name in truth.columns:
            true = truth[name][window.true]
        else:
            continue
        error = np.abs(estimates[name][window.estimated] - true)
        found[name] = float(np.mean(error <= SD_95 * estimates.sd(name)[window.estimated]))
    return found


def _rms(values: Floats | None) -> float | None:
    return None if values is None else rms(values)


def _largest(values: Floats | None) -> float | None:
    return None if values is None or not np.isfinite(values).all() else float(np.abs(values).max())


def _slope(rotation: Floats, error: Floats | None) -> float | None:
    """Least-squares slope of rotation + error over rotation: 1 plus the slope of the error."""
    if error is None or not np.isfinite(error).all() or np.ptp(rotation) < _SLOPE_NEEDS_RAD:
        return None
    centred = rotation - rotation.mean()
    return 1.0 + float(centred @ error / (centred @ centred))


def _stiffness_per_s2(estimates: Estimates, truth: Truth) -> float:
    """The target stiffness the loop was told to make, or else the mean of the true ones."""
    stated = estimates.header.get("target_stiffness_per_s2")
    constants = truth.constants
    return float(stated) if stated else (constants["kxx_per_s2"] + constants["kyy_per_s2"]) / 2
