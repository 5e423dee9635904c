"""A minute of S-slow in lockstep on a bad line, beside the same minute on a clean one, and what was noticed of it."""

from typing import Any

from benchmarks.lockstep import ClosedLoop, bench_of, close_loop, rms, scenario_of
from benchmarks.row import Row, Say

SECONDS, SETTLED_S, SEED = 60.0, 8.0, 1
LINES: dict[str, dict[str, Any]] = {
    "clean": {},
    "1 % lost, 0.1 % corrupted": {"lost": 0.01, "corrupted": 0.001},
    "the same, 1 % each repeated, reordered, delayed": {
        "lost": 0.01,
        "corrupted": 0.001,
        "duplicated": 0.01,
        "reordered": 0.01,
        "delayed": 0.01,
        "delay_s": (0.0, 0.002),
    },
}


def on_a_line(faults: dict[str, object], seed: int = SEED, seconds: float = SECONDS) -> ClosedLoop:
    """The run, with the faults given."""
    scenario = scenario_of("s-slow", faults=faults)
    return close_loop(scenario, bench_of("s-slow"), round(seconds * scenario.board.sample_rate_Hz), seed=seed)


def angle_error(run: ClosedLoop) -> float:
    """Reported minus true angle, rms in rad, zero at the start of the scored window."""
    error = (run.estimates["angle_rad"] - run.at("angle_rad"))[run.tick >= SETTLED_S * run.sample_rate_Hz]
    return rms(error - error[0])


def unnoticed(run: ClosedLoop) -> int:
    """Frames harmed on the way that neither end missed: each one lost or corrupted is a gap in a sequence."""
    harmed = {way: run.inflicted.get(f"lost_to_{way}", 0) + run.inflicted.get(f"corrupted_to_{way}", 0) for way in WAYS}
    return abs(harmed["host"] - run.frames["lost"]) + abs(harmed["board"] - run.counters.board["lost_seq"])


WAYS = ("host", "board")


def rows(say: Say) -> list[Row]:
    """Angle errors, their ratio to the clean run's, and the books."""
    figures = []
    clean: float | None = None
    for name, faults in LINES.items():
        run = on_a_line(dict(faults))
        error = angle_error(run)
        clean = error if clean is None else clean
        figures.append(Row(f"{name}: angle error rms", error, "rad", "a clean line", error / clean))
        figures.append(Row(f"{name}: samples lost", float(run.counters.lost), "1"))
        if "duplicated" not in faults:  # a frame overtaken or late is a gap, too, and counted beside these
            figures.append(Row(f"{name}: frames harmed unnoticed", float(unnoticed(run)), "1"))
        say(f"{name}: {error:.3g} rad; {dict(run.inflicted)}")
    return figures
