"""Which records there are: devices like S-slow, drawn."""

import json
import math
import tempfile
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.lockstep import ClosedLoop, bench_of, close_loop
from benchmarks.verdicts.campaign import toml_of
from device_emulator.scenario import load
from hil.bench import Bench
from hil.bench.examples import find
from hil.comparing.course import given
from hil.comparing.methods import methods_on
from hil.library.given import write_capture
from hil.records.methods import Methods
from hil.records.truth import Truth

CASES = ("as shipped", "without dither", "ten times the noise")
RECORDS = {"as shipped": 6, "without dither": 3, "ten times the noise": 3}
_BENCH: dict[str, dict[str, dict[str, Any]]] = {
    "as shipped": {},
    "without dither": {"controller": {"dither_mps2": 0.0}},
    "ten times the noise": {"device": {"sense": {"noise_V": 8.9e-4}}},
}
_NOISE_V = {"ten times the noise": 8.854e-4}
_DRAW = 0xC0FFEE
_SECONDS, _SETTLE_S = 30.0, 8.0
_MEAN_N_PER_M, _DAMPING = 1579.1367, 1.25664e-3


@dataclass(frozen=True)
class Planned:
    """One record."""

    case: str
    device: int

    @property
    def name(self) -> str:
        """Name of its file."""
        return f"{self.case.replace(' ', '-')}-{self.device}"

    def scenario(self) -> dict[str, Any]:
        """What is drawn: 2 % of stiffness, 10 % of damping apart in some direction, offsets of 5 to 15 %."""
        rng = np.random.default_rng([_DRAW, self.device])

        def apart(mean: float, share: float) -> list[float]:
            turned = rng.uniform(0.0, 2.0 * math.pi)
            one, across = share * math.cos(turned), share * math.sin(turned)
            return [mean * (1.0 + one), mean * (1.0 - one), mean * across]

        begin = rng.uniform(0.0, math.pi)
        truth = {
            "stiffness_N_per_m": apart(_MEAN_N_PER_M, 0.02),
            "damping_N_s_per_m": apart(_DAMPING, 0.1),
            "position_m": [1e-4 * math.cos(begin), 1e-4 * math.sin(begin)],
        }
        offsets = (rng.choice([-1.0, 1.0], 2) * rng.uniform(5e-6, 15e-6, 2)).tolist()
        rates = rng.uniform(-math.pi / 2, math.pi / 2, 2).tolist()
        segments = [
            {"kind": "constant", "duration_s": 10.0, "rate_rad_s": rates[0]},
            {"kind": "constant", "duration_s": 4.0, "rate_rad_s": rates[1]},
            {"kind": "constant", "duration_s": 4.0, "rate_rad_s": 0.0},
            {
                "kind": "sine", "amplitude_rad_s": rng.uniform(0.3, 1.5), "frequency_Hz": rng.uniform(0.2, 1.0),
                "offset_rad_s": rng.uniform(-0.5, 0.5),
            },
        ]  # fmt: skip
        sense: dict[str, Any] = {"mismatch_m": offsets}
        if self.case in _NOISE_V:
            sense["noise_V"] = _NOISE_V[self.case]
        return {"truth": truth, "sense": sense, "rate": {"kind": "segments", "segment": segments}}

    def compared(self) -> Methods:
        """Every method on it."""
        seed = 1000 + self.device
        changes = {section: dict(keys) for section, keys in _BENCH[self.case].items()}
        bench = bench_of("s-slow", **changes).with_(loop={"settle_s": _SETTLE_S, "seed": seed})
        with tempfile.TemporaryDirectory() as place:
            file = Path(place) / "drawn.scenario.toml"
            file.write_text(_scenario_text(self.scenario()), encoding="utf-8")
            scenario = load(file)
            samples = round(_SECONDS * scenario.board.sample_rate_Hz)
            run = close_loop(scenario, bench, samples, seed=seed, every=40)
            record = Path(place) / "record.arrow"
            write_capture(_columns(run), record)
            found, _ = methods_on(
                given(record, bench), self.name, truth=_truth(run, bench), link=f"inproc:{file}",
                progress=lambda _: None,
            )  # fmt: skip
        return found


def _columns(run: ClosedLoop) -> dict[str, Any]:
    """The record in SI, as an interchange file has it."""
    tick, vx, vy, ux, uy, _ = run.capture.T
    quantum, volts = run.observer.drive_quantum, run.observer.sense_quantum
    return {
        "t_s": tick / run.sample_rate_Hz, "vx_V": vx * volts[0], "vy_V": vy * volts[1],
        "ux_mps2": ux * quantum, "uy_mps2": uy * quantum,
    }  # fmt: skip


def _truth(run: ClosedLoop, bench: Bench) -> Truth:
    n = len(run.capture)
    columns: dict[str, npt.NDArray[Any]] = {name: values[:n] for name, values in run.truth.items()}
    columns["tick"] = np.arange(n)
    named = list(run.constants.values())
    header = {
        "stiffness_per_s2": named[:3], "damping_per_s": named[3:], "sample_rate_Hz": bench.device.sample_rate_Hz,
    }  # fmt: skip
    return Truth(columns, header, complete=True)


def _scenario_text(drawn: dict[str, Any]) -> str:
    """The example's scenario with what was drawn, as a file."""
    table = tomllib.loads(find("scenario", "s-slow").read_text(encoding="utf-8"))
    segments = drawn["rate"]["segment"]
    plain = {name: value for name, value in table.items() if name != "rate"}
    plain |= {section: table[section] | drawn[section] for section in ("truth", "sense")}
    lines = [toml_of(plain), "[rate]", 'kind = "segments"']
    for segment in segments:
        lines += ["[[rate.segment]]", *(f"{key} = {json.dumps(value)}" for key, value in segment.items())]
    return "\n".join(lines) + "\n"
