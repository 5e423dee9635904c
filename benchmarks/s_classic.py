"""The rate of S-classic at amplitude / noise = 20, beside the posterior Cramér–Rao bound of the same records.

Chi & Chen (Sensors & Transducers 6, 2009) report 1e-2 rad/s at that ratio.  Three cases, each at a constant 5 rad/s:
`s-classic` as it is, whose bench file gives the rate a random walk of 20 rad/s per √s; the same with a rate that hardly
moves and no forgetting; and `s-classic-constant`, the same but for stiffnesses that are trimmed.  The bound is the
covariance recursion along the true trajectory with the bench file's own noises and no fading memory.
"""

import math
from typing import Any

import numpy as np

from benchmarks.lockstep import ClosedLoop, Floats, bench_of, close_loop, rms, scenario_of
from benchmarks.row import Row, Say
from estimator.observer import Observer
from hil.bench import Bench, override
from hil.inputs.declared import device_of, observer_settings_of

SEEDS = 4
SAMPLES = 128_000
EVERY = 16_000
RATE = 5.0
CONSTANT: dict[str, Any] = {"gain": "ekf", "process_noise": {"rate_rad_s_per_rts": 1e-3}}
CASES: tuple[tuple[str, str, dict[str, Any]], ...] = (
    ("as it is", "s-classic", {}),
    ("hardly moving", "s-classic", CONSTANT),
    ("hardly moving, trimmed", "s-classic-constant", {}),
)
MOTION = ("x_m", "vx_mps", "y_m", "vy_mps", "phi_x_V", "phi_y_V", "rate_rad_s")


def bound(run: ClosedLoop, bench: Bench) -> Floats:
    """Least deviation of the rate at the estimates' ticks (rows,), rad/s."""
    n = len(run.capture)
    true = np.empty((n, 13))
    true[1:, :7] = np.stack([run.truth[name][: n - 1] for name in MOTION], axis=1)
    true[0, :7] = true[1, :7]
    true[:, 7:] = list(run.constants.values())
    drive = np.asarray(run.capture[:, 3:5] * run.observer.drive_quantum, dtype=float)
    unforgetting = override(bench, {"observer": {"gain": "ekf"}}, "bound")
    observer = Observer(device_of(unforgetting), observer_settings_of(unforgetting))
    found = observer.run(np.zeros((n, 2)), drive, every=EVERY, truth=true)
    return found.deviation[:, found.names.index("rate")]


def rows(say: Say) -> list[Row]:
    """At a quarter of a second, half a second and a second: error, what the observer says of it, and the bound."""
    figures = []
    for what, name, changes in CASES:
        scenario = scenario_of(name, rate={"kind": "constant", "rate_rad_s": RATE})
        bench = bench_of(name, observer=changes)
        errors, claimed, bounds = [], [], []
        for seed in range(SEEDS):
            run = close_loop(scenario, bench, SAMPLES, seed=seed, every=EVERY)
            errors.append(run.estimates["rate_rad_s"] - RATE)
            claimed.append(run.estimates["sd_rate_rad_s"])
            bounds.append(bound(run, bench))
            say(f"{what}, seed {seed}")
        for row in (1, 3, 7):
            limit = math.sqrt(np.mean(np.array(bounds)[:, row] ** 2))
            error, said = rms(np.array(errors)[:, row]), rms(np.array(claimed)[:, row])
            at = f"{what}, after {(row + 1) * EVERY / 128e3:g} s"
            figures += [
                Row(f"{at}, rate error, rms of {SEEDS}", error, "rad/s", "Cramér–Rao bound", error / limit),
                Row(f"{at}, deviation that the observer says", said, "rad/s", "Cramér–Rao bound", said / limit),
            ]
    return figures
