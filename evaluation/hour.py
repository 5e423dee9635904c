"""An hour of bench time at 100 kS/s, whole-angle, 1/f noise on: `python -m evaluation.hour --folder F`.

S-modern at 5 kHz at rest, its pattern turned by the virtual rotation; 1/f noise of sense, drive and bias.  `hil run`,
then `hil characterise`; angle random walk and bias instability beside what was injected, the Allan deviation beside
allantools, which reads the same rates.  To the walk by the board's force noise adds that by its sense noise
(docs/explanation.md).  An hour leaves 20 GB in F.  `--kept` reads a run that is there.

Beside that the angle has a noise of its own, by the sense noise: 0.05 mrad, which is no walk.  It hides a walk over
less than 3 Q²/N² seconds, and 1/f noise hides it over more than N²/(B² 2 ln 2/π).  So the board's force noise is that
of a temperature at which the walk shows in between.
"""

import argparse
import json
import math
import resource
import subprocess
import sys
import time
from pathlib import Path

import allantools
import numpy as np

from device_emulator.scenario import Scenario, load
from hil.bench import Bench, load_bench
from hil.bench.examples import find
from hil.records.runfolder import RunFolder

BIAS_1HZ, SENSE_1HZ, DRIVE_1HZ = 5e-6, 1e-6, 1e-5
"""1/f at 1 Hz: rad/s, V and m/s², each per √Hz."""
TEMPERATURE_K = 1200.0
BOLTZMANN = 1.380649e-23
DEG_PER_H, DEG_PER_RTH = math.degrees(3600.0), math.degrees(60.0)
RATE_S = 0.1


def written(folder: Path, seconds: float, seed: int) -> Path:
    """Scenario, of that seed, and bench file in `folder`; the bench file's path."""
    folder.mkdir(parents=True, exist_ok=True)
    board = find("scenario", "s-modern-5k").read_text(encoding="utf-8").partition("[rate]")[0]
    assert "\nseed = 1\n" in board
    board = board.replace("\nseed = 1\n", f"\nseed = {seed}\n")
    for line, more in (
        ("mass_kg = 1e-8\n", f"temperature_K = {TEMPERATURE_K}\n"),
        ("position_m = [2e-6, 0.0]\n", f"bias_flicker_rad_s_at_1Hz = {BIAS_1HZ}\n"),
        ("noise_V = 5.6e-5\n", f"flicker_V_at_1Hz = {SENSE_1HZ}\n"),
        ("latency_samples = 1\n", f"flicker_mps2_at_1Hz = {DRIVE_1HZ}\n"),
    ):
        assert line in board
        board = board.replace(line, line + more)
    (folder / "hour.scenario.toml").write_text(board + '[rate]\nkind = "constant"\nrate_rad_s = 0.0\n', "utf-8")
    bench = find("bench", "s-modern-5k").read_text(encoding="utf-8")
    for old, new in (
        ('clock = "paced"', 'clock = "lockstep"'),
        ("duration_s = 10.0", f"duration_s = {seconds}"),
        ('"pty:s-modern-5k.scenario.toml"', '"inproc:hour.scenario.toml"'),
    ):
        assert old in bench
        bench = bench.replace(old, new)
    path = folder / "hour.bench.toml"
    path.write_text(bench, encoding="utf-8")
    return path


def injected(board: Scenario, bench: Bench) -> dict[str, float]:
    """Angle random walk [rad/√s], by force noise √(4 kB T d)/m over 2 ω A, by sense noise σ/A √(2/fs) times the root of
    Ωv² + (Δω/2)²; bias instability [rad/s], h √π (IEEE Std 952).
    """
    mass, (kxx, kyy, kxy), (dxx, dyy, _) = (
        board.truth.mass_kg,
        board.truth.stiffness_N_per_m,
        board.truth.damping_N_s_per_m,
    )
    force = math.sqrt(4.0 * BOLTZMANN * board.truth.temperature_K * 0.5 * (dxx + dyy)) / mass
    omega = math.sqrt(0.5 * (kxx + kyy) / mass)
    amplitude, rate_Hz = board.truth.position_m[0], board.board.sample_rate_Hz
    gain = bench.device.sense.gain_V_per_m[0]
    seen = abs(board.sense.noise_V / (gain * amplitude)) * math.sqrt(2.0 / rate_Hz)
    half_split = math.hypot(kxx - kyy, 2.0 * kxy) / (4.0 * mass * omega)
    by_sense = seen * math.hypot(bench.controller.virtual_rotation_rad_s, half_split)
    return {
        "angle_random_walk": math.hypot(force / (2.0 * omega * amplitude), by_sense),
        "bias_instability": board.truth.bias_flicker_rad_s_at_1Hz * math.sqrt(math.pi),
    }


def oracle(run: RunFolder, expected: dict[str, float], angle_rad: float) -> None:
    """Print the Allan deviation of means of 0.1 s by allantools beside white and 1/f noise as injected, and a noise of
    the angle as it was read."""
    estimates = run.estimates
    assert estimates is not None
    t_s = np.asarray(estimates["tick"]) / 1e5
    late = t_s >= 2.0
    step = round(RATE_S / float(t_s[1] - t_s[0]))
    angle = np.asarray(estimates["angle_rad"])[late][::step]
    tau, deviation, error, _ = allantools.oadev(angle, 1.0 / RATE_S, "phase", [1.0, 3.0, 10.0, 30.0, 100.0, 300.0])
    white, flicker = (
        expected["angle_random_walk"] ** 2,
        expected["bias_instability"] ** 2 * 2.0 * math.log(2.0) / math.pi,
    )
    for at, found, sd in zip(tau, deviation, error, strict=True):
        told = math.sqrt(3.0 * angle_rad**2 / at**2 + white / at + flicker)
        print(
            f"allantools, {at:g} s: {found * DEG_PER_H:.3g} ± {2 * sd * DEG_PER_H:.2g} °/h; "
            f"injected {told * DEG_PER_H:.3g}"
        )


def main() -> None:
    """Run, characterise, and print."""
    parser = argparse.ArgumentParser(prog="python -m evaluation.hour", description=__doc__)
    parser.add_argument("--folder", type=Path, required=True)
    parser.add_argument("--seconds", type=float, default=3600.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kept", action="store_true")
    given = parser.parse_args()
    bench = written(given.folder, given.seconds, given.seed)
    if not given.kept:
        begun = time.monotonic()
        subprocess.run([sys.executable, "-m", "hil", "run", bench.name, "--out", "runs"], cwd=given.folder, check=False)
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        print(f"run: {time.monotonic() - begun:.0f} s, of the processor {used.ru_utime + used.ru_stime:.0f} s")
    (place,) = (given.folder / "runs").iterdir()
    asked = [sys.executable, "-m", "hil", "characterise", str(place), "--out", str(given.folder / "sheets"), "--json"]
    told = subprocess.run(asked, capture_output=True, text=True, check=False)
    expected = injected(load(given.folder / "hour.scenario.toml"), load_bench(bench))
    angle_rad = 0.0
    for row in json.loads(told.stdout)["rows"]:
        name = row["figure"]
        if name == "quantisation" and row["value"] is not None:
            angle_rad = row["value"]
            print(f"noise of the angle: {angle_rad:.3g} ({row['low']:.3g} to {row['high']:.3g}) rad")
        if name == "start_up":
            print(f"start-up: {row['value']} s")
        if row["value"] is None or not (name in expected or name.endswith("theta") or name == "bias"):
            continue
        scale = DEG_PER_RTH if name == "angle_random_walk" else DEG_PER_H
        unit = "°/√h" if name == "angle_random_walk" else "°/h"
        low, value, high = ((math.nan if row[key] is None else row[key]) * scale for key in ("low", "value", "high"))
        true = expected.get(name, 0.0) * scale
        print(f"{name}: {value:.4g} ({low:.4g} to {high:.4g}) {unit}; injected {true:.4g}")
    oracle(RunFolder(place), expected, angle_rad)


if __name__ == "__main__":
    main()
