"""Initial values of an observer, as far off the truth as its bench file declares.

An observer's covariance can be checked only where its initial uncertainty is true.  So the initial values are drawn
about the true state of the board, with the spread that the bench declares.  That equals boards that scatter about one
data sheet; here the campaign sets the truth of each.
"""

from pathlib import Path

import numpy as np

from hil.bench import Bench
from hil.errors import InputError
from hil.records.truth import Truth, read_truth
from hil.running.recording.tracks import column_of

_SAMPLES = 16
_DRAW = 0x6775657373  # any fixed number: apart from the noise of the same seed


def with_drawn_initial_values(bench: Bench, scenario: Path, place: Path) -> Bench:
    """`bench` with [observer.initial] drawn by the run's seed; the board of `scenario` is started for a moment, in
    `place`, to know its truth.

    Raises InputError where the model has a single axis.
    """
    from estimator.observer import Observer
    from hil.inputs.declared import device_of, observer_settings_of

    if bench.device.axes != 2:
        raise InputError("[each] drawn_initial: needs a bench of two axes; leave it out")
    observer = Observer(device_of(bench), observer_settings_of(bench))
    mean = _just_before(_first_moment(bench, scenario, place), bench.device.sample_rate_Hz)
    spread = np.sqrt(np.diag(observer.covariance))
    normal = np.random.default_rng([_DRAW, bench.loop.seed or 0]).standard_normal(len(spread))
    names = [column_of(name) for name in observer.estimated]
    drawn = mean | {n: mean[n] + s * z for n, s, z in zip(names, spread, normal, strict=True) if n in mean}
    mass = bench.device.mass_kg
    initial = {
        "position_m": (drawn["x_m"], drawn["y_m"]),
        "velocity_mps": (drawn["vx_mps"], drawn["vy_mps"]),
        "offset_V": (drawn["phi_x_V"], drawn["phi_y_V"]),
        "rate_rad_s": drawn["rate_rad_s"],
        "stiffness_N_per_m": tuple(mass * drawn[f"k{axes}_per_s2"] for axes in ("xx", "yy", "xy")),
        "damping_N_s_per_m": tuple(mass * drawn[f"d{axes}_per_s"] for axes in ("xx", "yy", "xy")),
    }
    return bench.with_(observer={"initial": initial})


def _first_moment(bench: Bench, scenario: Path, place: Path) -> Truth:
    """Truth of the first samples of that board, with the run's own seed."""
    from hil.running.process.worker import Order, untold, work
    from hil.running.request import RunRequest

    rate_Hz = bench.device.sample_rate_Hz
    samples = 2 * bench.loop.block if bench.loop.in_blocks else _SAMPLES
    short = bench.with_(
        loop={
            "duration_s": samples / rate_Hz,
            "settle_s": 0.0,
            "estimate_every": bench.loop.block if bench.loop.in_blocks else 1,
            "covariance_every": None,
        }
    )
    folder, truth = place / "first", place / "first.arrow"
    folder.mkdir()
    request = RunRequest(short, f"inproc:{scenario}", {"truth": truth})
    work(Order(request, str(folder)), untold, own_process=False)
    return read_truth(truth)


def _just_before(truth: Truth, rate_Hz: float) -> dict[str, float]:
    """The true state one interval before the first sample, where an observer starts, by the base model's flow."""
    from scipy.linalg import expm

    first = {name: float(np.asarray(truth[name])[0]) for name in truth.columns if name != "tick"} | truth.constants
    kxx, kyy, kxy = (first[f"k{axes}_per_s2"] for axes in ("xx", "yy", "xy"))
    dxx, dyy, dxy = (first[f"d{axes}_per_s"] for axes in ("xx", "yy", "xy"))
    w = first["rate_rad_s"]
    a = np.array(
        [[0, 1, 0, 0], [w * w - kxx, -dxx, -kxy, 2 * w - dxy], [0, 0, 0, 1], [-kxy, -dxy - 2 * w, w * w - kyy, -dyy]]
    )
    names = ("x_m", "vx_mps", "y_m", "vy_mps")
    motion = expm(-a / rate_Hz) @ np.array([first[name] for name in names])
    return first | dict(zip(names, map(float, motion), strict=True))
