"""A closed loop in one process for the figures: emulated board, real codecs, the product's own loop; arrays at the end.

Nothing of the loop is replaced: the loop of the bench's mode talks over an in-process link to the board of
`device_emulator`, and only the record files are, by arrays in memory.  The truth is what the emulator hands out for
its truth file.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from device_emulator.board import Board
from device_emulator.device import TRUTH_COLUMNS, Device
from device_emulator.line import Line
from device_emulator.scenario import Scenario, load
from estimator.observer import Observer
from hil.bench import Bench, load_bench, override
from hil.bench.examples import find
from hil.plugins.of_bench import loop_observer
from hil.records.estimates import ANGLE_COLUMNS
from hil.running.loop.skeleton import Counters
from hil.running.process.worker import make_loop
from hil.running.recording.tracks import column_of
from hil.running.safety.preflight import configure
from hil.wire import client
from hil.wire.endpoint import Endpoint
from hil.wire.inproc import InprocLink
from hil.wire.messages import ClockMode, SafeReason

Floats = NDArray[np.float64]


class Rows:
    """A record in memory instead of a file."""

    dropped = 0

    def __init__(self, columns: int) -> None:
        self._columns = columns
        self._flat: list[float] = []

    def put(self, *values: float) -> bool:
        """Append one row."""
        self._flat.extend(values)
        return True

    def push(self, rows: NDArray[np.void]) -> int:
        """Append rows."""
        for row in rows.tolist():
            self._flat.extend(row)
        return len(rows)

    @property
    def array(self) -> Floats:
        """(rows, columns)."""
        return np.array(self._flat).reshape(-1, self._columns)


@dataclass(frozen=True)
class ClosedLoop:
    """What came of a run: columns by name, estimates at ticks `tick`, truth at every tick, innovation at every tick."""

    tick: NDArray[np.int64]
    estimates: dict[str, Floats]
    truth: dict[str, Floats]
    constants: dict[str, float]
    innovation_V: Floats
    innovation_sd_V: Floats
    capture: NDArray[np.int64]  # tick, vx, vy, ux, uy, flags
    sample_rate_Hz: float
    observer: Observer
    counters: Counters
    inflicted: Mapping[str, int]  # by the scenario's faults
    frames: dict[str, int]  # what the host's receiver counted: lost, repeated, damaged

    def at(self, name: str) -> Floats:
        """The truth of a column at the ticks of the estimates."""
        return self.truth[name][self.tick]


class _OnLine:
    """A board behind the line of its scenario."""

    def __init__(self, board: Board, line: Line) -> None:
        self.exchange, self.close = line.exchange, board.close


def scenario_of(name: str, **changes: dict[str, Any]) -> Scenario:
    """An example's scenario with keys replaced, `truth={"mass_kg": 2e-3}`; a `rate` is replaced as a whole."""
    table = load(find("scenario", name)).model_dump()
    for section, keys in changes.items():
        if section == "rate":
            table["rate"] = keys
        else:
            table[section].update(keys)
    return Scenario.model_validate(table)


def bench_of(name: str, **changes: dict[str, Any]) -> Bench:
    """An example's bench with keys replaced; sub-tables of [device] and [observer] are updated, not replaced."""
    bench = load_bench(Path(find("bench", name)))
    for section, keys in changes.items():
        old = getattr(bench, section).model_dump()
        changes[section] = {
            key: {**old[key], **value} if isinstance(value, dict) and isinstance(old.get(key), dict) else value
            for key, value in keys.items()
        }
    return override(bench, {"loop": {"settle_s": 0.0}, **changes}, name)


def close_loop(scenario: Scenario, bench: Bench, samples: int, *, seed: int, every: int = 8) -> ClosedLoop:
    """Run `samples` samples in lockstep, estimates at every `every`-th."""
    pages: list[Floats] = []
    device = Device(scenario, seed, lambda _, rows: pages.append(rows.copy()))
    board = Board(scenario, device, (ClockMode.LOCKSTEP,))
    bench = override(bench, {"loop": {"clock": "lockstep", "estimate_every": every}}, "benchmark")
    line = Line(board, scenario, seed)
    endpoint = Endpoint(InprocLink(_OnLine(board, line) if scenario.faults.on_the_line else board))
    identity = client.connect(endpoint)
    observer = loop_observer(bench, identity)
    states = len(observer.names)
    tracks = {
        "capture": Rows(6),
        "innovation": Rows(5),
        "covariance": Rows(1 + len(observer.estimated) * (len(observer.estimated) + 1) // 2),
        "timing": Rows(4 if bench.loop.mode == "force" else 6),
        "estimates": Rows(1 + 2 * states + len(ANGLE_COLUMNS) + 1),
    }
    registers = configure(endpoint, identity, bench)
    loop = make_loop(endpoint, identity, bench, observer, tracks, registers)
    loop.arm()
    loop.run(samples, lambda done: None, samples)
    loop.finish(SafeReason.HOST_REQUEST)
    endpoint.close()
    truth = np.concatenate(pages)
    names = [column_of(name) for name in observer.names]
    columns = ["tick", *names, *(f"sd_{name}" for name in names), *ANGLE_COLUMNS, "valid"]
    estimates = tracks["estimates"].array
    innovation = tracks["innovation"].array
    mass = scenario.truth.mass_kg
    constants = dict(
        zip(
            ("kxx_per_s2", "kyy_per_s2", "kxy_per_s2"),
            (k / mass for k in scenario.truth.stiffness_N_per_m),
            strict=True,
        )
    )
    constants |= dict(
        zip(("dxx_per_s", "dyy_per_s", "dxy_per_s"), (d / mass for d in scenario.truth.damping_N_s_per_m), strict=True)
    )
    return ClosedLoop(
        tick=estimates[:, 0].astype(np.int64),
        estimates={name: estimates[:, i] for i, name in enumerate(columns)},
        truth={name: truth[:, i] for i, name in enumerate(TRUTH_COLUMNS)},
        constants=constants,
        innovation_V=innovation[:, 1:3],
        innovation_sd_V=innovation[:, 3:5],
        capture=tracks["capture"].array.astype(np.int64),
        sample_rate_Hz=scenario.board.sample_rate_Hz,
        observer=observer,
        counters=loop.counters,
        inflicted=dict(line.inflicted),
        frames={"lost": endpoint.rx.lost, "repeated": endpoint.rx.repeated, "damaged": endpoint.rx.bad},
    )


def slope(reported: Floats, true: Floats) -> float:
    """Least-squares slope of one angle over another."""
    return float(np.polyfit(true - true[0], reported - reported[0], 1)[0])


def rms(values: Floats) -> float:
    """Root mean square."""
    return math.sqrt(float(np.mean(values**2)))
