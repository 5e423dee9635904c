"""What hil identify predicts of emulated boards over what they do: `python -m evaluation.identifying.advised`.

Boards are drawn as in `evaluation.identifying`.  Each is identified; its bench file then runs on the same board.
Noise: of the reported angle at a constant rate, less its drift and its harmonics in the angle of the pattern, which are
a bias and an angle-dependent bias, between instants so far apart that the predicted noise and random walk add up, and
over so many memories that it scatters by a few percent; its standard uncertainty is told, by parts that are long enough
to be independent.  `with_bias` is the ratio with the harmonics left in.
Bandwidths: sines of the rate about those predicted, to which the estimates are fitted.
Margin: runs in which the drive acts later than IDENTITY says, in steps of a tenth of it.
"""

import argparse
import json
import math
import pickle
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.identify.prediction import Holding, Prediction, share_of_limit
from evaluation.identifying.__main__ import here
from evaluation.identifying.boards import Drawn, draw, written
from hil.bench import Bench
from hil.identifying.advice import predicted
from hil.identifying.bench_file import bench_of
from hil.identifying.findings import Findings
from hil.identifying.identify import identify
from hil.identifying.request import request_of
from hil.progress import untold
from hil.records.estimates import Estimates
from hil.running.options import LocalRunOptions
from hil.running.request import request_of as run_request

_SETTLE, _STILL, _SINE = 3.0, 120.0, 2.0  # memories
_BLOCK = 12.0  # of them, in which the noise is taken by itself: how it scatters is its interval
_ABOUT = (0.8, 1.25)  # of a predicted bandwidth
_LATE, _FARTHEST = 0.1, 0.45  # of a predicted margin
_LAG = 2.0  # memories, over which the angle's noise is taken: beyond it two estimates have little in common
_WITHIN = 0.2
_HARMONICS = 4


def found_of(seed: int, drawn: Drawn, folder: Path) -> tuple[Findings, Bench]:
    """A board identified, and its bench file; kept in `folder`: whoever asks again goes on from there."""
    kept = folder / f"{seed}.findings.pkl"
    mass = float(drawn.text.split("mass_kg = ")[1].split()[0])
    request = request_of(f"inproc:{written(drawn, folder, str(seed))}", None, {"mass_kg": mass})
    if not kept.exists():
        kept.write_bytes(pickle.dumps(identify(request, folder, untold, run=here, report=False).findings))
    found: Findings = pickle.loads(kept.read_bytes())
    return found, bench_of(found, request)


def ran(bench: Bench, drawn: Drawn, memories: float, folder: Path, change: str) -> Estimates:
    """Estimates of a run of so many memories on the board with its rate, or an effect, as `change` says."""
    memory = bench.memory_s
    text = drawn.text.partition("[rate]")[0] + change
    scenario = folder / "changed.scenario.toml"
    scenario.write_text(text, encoding="utf-8")
    loop = bench.loop.model_copy(update={"duration_s": memories * memory, "settle_s": _SETTLE * memory})
    request = run_request(
        bench.model_copy(update={"loop": loop}), LocalRunOptions(clock="lockstep"), link=f"inproc:{scenario}"
    )
    done = here(replace(request, judged=False), folder)
    assert done.folder is not None
    from hil.records.runfolder import RunFolder

    estimates = RunFolder(done.folder).estimates
    assert estimates is not None
    return estimates


def turned(bench: Bench, drawn: Drawn, found: Prediction, ratio: float, folder: Path) -> dict[str, float]:
    """Noise of the angle [rad] over the lag with its standard uncertainty, and bandwidths [Hz], of one run.

    ratio: sense noise over amplitude.
    """
    memory, rate = bench.memory_s, drawn.truth["rate"]
    bandwidths = {"rate": found.rate_bandwidth_Hz, "angle": found.angle_bandwidth_Hz}
    sines = [(name, share * hertz) for name, hertz in bandwidths.items() if math.isfinite(hertz) for share in _ABOUT]
    text = '[rate]\nkind = "segments"\n' + _piece(f'kind = "constant"\nrate_rad_s = {rate!r}', _SETTLE + _STILL, memory)
    for _, hertz in sines:
        size = 2.0 * math.pi * hertz * ratio
        sine = f'kind = "sine"\namplitude_rad_s = {size!r}\nfrequency_Hz = {hertz!r}\noffset_rad_s = {rate!r}'
        text += _piece(sine, _SINE, memory)
    text += f'[[rate.segment]]\nkind = "constant"\nrate_rad_s = {rate!r}\n'
    table = ran(bench, drawn, _SETTLE + _STILL + _SINE * len(sines), folder, text)
    time_s = table["tick"] / table.tick_rate_Hz
    still = (time_s > (_SETTLE + 0.1) * memory) & (time_s < (_SETTLE + _STILL) * memory)
    error = table["angle_rad"][still] - rate * time_s[still]
    lag = round(_LAG * memory / (time_s[1] - time_s[0]))
    pattern = (rate + bench.controller.virtual_rotation_rad_s) * bench.device.calibration.angular_gain * time_s[still]
    periodic = [turn(k * pattern) for k in range(1, _HARMONICS + 1) for turn in (np.cos, np.sin)]
    columns = np.column_stack([np.ones_like(error), time_s[still], *periodic])
    random = error - columns @ np.linalg.lstsq(columns, error, rcond=None)[0]
    squares = _squares(random, lag)
    parts = [float(np.mean(part)) for part in np.array_split(squares, round(_STILL / _BLOCK))]
    measured = {"noise": float(np.sqrt(np.mean(squares))), "with_bias": float(np.sqrt(np.mean(_squares(error, lag))))}
    measured["noise_u"] = 0.5 * float(np.std(parts, ddof=1)) / math.sqrt(len(parts)) / measured["noise"]
    gains: dict[str, list[tuple[float, float]]] = {}
    for k, (name, hertz) in enumerate(sines):
        begin = _SETTLE + _STILL + _SINE * k
        rows = (time_s > (begin + 0.4 * _SINE) * memory) & (time_s < (begin + _SINE) * memory)
        column = table["rate_rad_s" if name == "rate" else "angle_rad"][rows]
        true = ratio * (2.0 * math.pi * hertz if name == "rate" else 1.0)
        gains.setdefault(name, []).append((hertz, _amplitude(time_s[rows], column, hertz) / true))
    for name, (low, high) in gains.items():
        slope = math.log(high[1] / low[1]) / math.log(high[0] / low[0])
        measured[name] = low[0] * (math.sqrt(0.5) / low[1]) ** (1.0 / slope)
    return measured


def _squares(error: NDArray[np.float64], lag: int) -> NDArray[np.float64]:
    """Halves of the squares by which an error (n,) grows over a lag, less its drift."""
    grown = error[lag:] - error[:-lag]
    return 0.5 * (grown - np.mean(grown)) ** 2


def margin_of(bench: Bench, drawn: Drawn, margin_s: float, folder: Path) -> float:
    """The delay [s] at which the verdict's limits are passed, of runs in steps of a tenth of what is predicted; beyond
    the last of them where they are not.
    """
    limits = bench.limits
    holding = Holding(limits.energy_error, limits.quadrature, limits.invalid_fraction)

    def share(late: float) -> float:
        effect = f'[[effect]]\nname = "drive_delay"\ntux = {late!r}\ntuy = {late!r}\n'
        turning = "[rate]" + drawn.text.partition("[rate]")[2]
        table = ran(bench, drawn, _SETTLE + 4.0, folder, effect + turning)
        rows = table["tick"] / table.tick_rate_Hz > _SETTLE * bench.memory_s
        return share_of_limit(table["energy_ratio"][rows], table["quadrature_ratio"][rows], holding)

    at, here_is = 1.0, share(margin_s)
    step = _LATE if here_is < 1.0 else -_LATE
    while abs(at + step - 1.0) < _FARTHEST:
        there_is = share((at + step) * margin_s)
        if (there_is < 1.0) != (here_is < 1.0):
            far = max(here_is, there_is)
            crossing = math.log(here_is) / math.log(here_is / there_is) if math.isfinite(far) else 0.5
            return (at + crossing * step) * margin_s
        at, here_is = at + step, there_is
    return (at + step) * margin_s


def of_board(seed: int, folder: Path) -> dict[str, Any]:
    """Predicted and measured figures of one."""
    drawn = draw(seed)
    found, bench = found_of(seed, drawn, folder)
    begun = time.process_time()
    told = predicted(bench, found.identity)
    spent = time.process_time() - begun
    ratio = float(np.max(found.noise_V)) / min(bench.swing_V)
    measured = turned(bench, drawn, told, ratio, folder)
    lag_s = _LAG * bench.memory_s
    noise = math.hypot(told.angle_noise_rad, told.angle_random_walk_rad_per_rts * math.sqrt(0.5 * lag_s))
    figures = {"noise": noise, "with_bias": noise, "rate": told.rate_bandwidth_Hz, "angle": told.angle_bandwidth_Hz}
    if told.delay_margin_s and not told.margin_open:
        figures["margin"] = told.delay_margin_s
        measured["margin"] = margin_of(bench, drawn, told.delay_margin_s, folder)
    ratios = {name: value / measured[name] for name, value in figures.items() if name in measured}
    ratios["noise_u"] = ratios["noise"] * measured["noise_u"] / measured["noise"]
    return {"seed": seed, "predicted": told._asdict(), "measured": measured, "ratio": ratios, "cpu_s": spent}


def main() -> None:
    """Print a line per board and the sums, and keep all of it as JSON."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--draw", type=int, required=True)
    parser.add_argument("--boards", type=int, default=20)
    parser.add_argument("--folder", type=Path, required=True)
    asked = parser.parse_args()
    asked.folder.mkdir(parents=True, exist_ok=True)
    rows = []
    for seed in range(asked.draw, asked.draw + asked.boards):
        rows.append(of_board(seed, asked.folder))
        print(seed, *(f"{name} {value:.3f}" for name, value in rows[-1]["ratio"].items()), flush=True)
        (asked.folder / "advised.json").write_text(json.dumps(rows, indent=1))
    for name in ("noise", "with_bias", "rate", "angle", "margin"):
        ratios: NDArray[np.float64] = np.array([row["ratio"][name] for row in rows if name in row["ratio"]])
        within = np.sum(np.abs(ratios - 1.0) <= _WITHIN)
        print(f"{name}: {within} of {len(ratios)} within 20 %, {np.min(ratios):.3f} to {np.max(ratios):.3f}")


def _piece(kind: str, memories: float, memory_s: float) -> str:
    return f"[[rate.segment]]\n{kind}\nduration_s = {memories * memory_s!r}\n"


def _amplitude(time_s: NDArray[np.float64], values: NDArray[np.float64], hertz: float) -> float:
    """Of a sine of that frequency beside a straight line."""
    phase = 2.0 * np.pi * hertz * time_s
    columns = np.stack([np.sin(phase), np.cos(phase), np.ones_like(time_s), time_s - time_s.mean()], axis=1)
    sine, cosine = np.linalg.lstsq(columns, values, rcond=None)[0][:2]
    return float(np.hypot(sine, cosine))


if __name__ == "__main__":
    main()
