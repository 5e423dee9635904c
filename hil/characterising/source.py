"""Records as rates that can be characterised: of a sensor each axis, of a whole-angle run what its angle did."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from estimator.characteristics.angle_map import pattern_angle
from hil.bench import Bench, RateSensorBench
from hil.errors import InputError
from hil.records.capture import Capture, read_capture
from hil.records.direct import cut_of
from hil.records.estimates import Estimates
from hil.records.rates import rates_rad_s
from hil.records.runfolder import RunFolder
from hil.records.truth import Truth
from hil.scoring.reference import reference_rate
from hil.scoring.score import require_same_run, truth_in

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


class Block(NamedTuple):
    """Samples in order: tick (n,) counted in samples, rate (n,) rad/s; how the device turned, its temperature, and the
    pattern's angle θ in the device's frame, (n,) each or None."""

    tick: Ints
    rate: Floats
    reference: Floats | None
    temperature: Floats | None
    theta: Floats | None

    def part(self, chosen: "slice | npt.NDArray[np.bool_]") -> "Block":
        """Those samples."""
        return Block(*(None if column is None else column[chosen] for column in self))  # type: ignore[arg-type]


@dataclass(frozen=True)
class Axis:
    """One rate of one record.

    span: ticks from its first sample to its last, both counted.  settled_from: tick from which on it counts.
    steady: each row is a state of its own.  `blocks` begins a pass.
    """

    name: str
    rate_Hz: float
    first: int
    span: int
    settled_from: int
    steady: bool
    blocks: Callable[[], Iterator[Block]]

    def late_by(self, seconds: float) -> "Axis":
        """The same beside a reference that is as much later; less what that leaves without one. A spline between its
        samples: half way between them, a straight line is smaller than a sine by (ωT)²/8.
        """
        from scipy.interpolate import CubicSpline

        def blocks() -> Iterator[Block]:
            for before, block, after in _with_neighbours(self.blocks()):
                near = [one for one in (before, block, after) if one is not None and one.reference is not None]
                tick = np.concatenate([one.tick for one in near])
                reference = np.concatenate([one.reference for one in near if one.reference is not None])
                at = block.tick - seconds * self.rate_Hz
                known = (tick[0] <= at) & (at <= tick[-1])
                if known.any() and tick.size > 1:
                    moved = block._replace(reference=CubicSpline(tick, reference)(at))
                    yield moved if known.all() else moved.part(known)

        return replace(self, blocks=blocks)


def _with_neighbours(blocks: Iterator[Block]) -> Iterator[tuple[Block | None, Block, Block | None]]:
    before, block = None, next(blocks, None)
    while block is not None:
        after = next(blocks, None)
        yield before, block, after
        before, block = block, after


def axes_of(place: Path, bench: Bench | RateSensorBench | None, truth: Path | None) -> list[Axis]:
    """The axes of a run folder or a capture.  Raises InputError where there is no rate in it."""
    folder = RunFolder(place if place.is_dir() else place.parent)
    is_run = place.is_dir() or place.name == "capture.arrow"
    estimates = folder.estimates if is_run else None
    if estimates is not None and "angle_rad" in estimates:
        if len(estimates) < 3:
            raise InputError(f"{folder.path}: {len(estimates)} estimates are no record; record for longer")
        known = None if truth is None else _truth(folder, truth)
        return [_whole_angle(folder, estimates, known)]
    if truth is not None:
        raise InputError(f"{truth}: {place} is no run of an emulated gyro; leave --truth out")
    capture = read_capture(folder.capture_path if place.is_dir() else place)
    if len(capture) < 3:
        raise InputError(f"{place}: {len(capture)} samples are no record; record for longer")
    if capture.axes == 0:
        first = capture.part(0, 1)
        return [_sampled(capture, axis, partial(_coded, axis)) for axis in rates_rad_s(first)]
    if isinstance(bench, RateSensorBench):
        from hil.tracing.rate_sensor import require_sensor_fit

        require_sensor_fit(capture, bench.device, place)
        return [_sampled(capture, bench.device.name, partial(_scaled, bench))]
    what = "a run of two axes, an imported rate with the bench file of its sensor (axes = 0), or a recorded sensor"
    raise InputError(f"{place}: no rate and no angle in it; give {what}")


def cuts_of(place: Path) -> list[str]:
    """Which files of a run folder or a capture were interrupted, a sentence each."""
    folder = RunFolder(place if place.is_dir() else place.parent)
    is_run = place.is_dir() or place.name == "capture.arrow"
    files = [folder.capture_path, folder.estimates_path] if is_run else [place]
    return [f"{file}: {cut}" for file in files if file.exists() and (cut := cut_of(file))]


def _truth(folder: RunFolder, file: Path) -> Truth:
    truth = truth_in(file)
    require_same_run(folder, truth, file)
    return truth


def _coded(axis: str, piece: Capture) -> Floats:
    name = f"rate_{axis}_code"
    return np.asarray(piece.columns[name] * float(piece.header["columns"][name]["scale"]))


def _scaled(bench: RateSensorBench, piece: Capture) -> Floats:
    return np.asarray((piece.sense_V[:, 0] - bench.device.offset_V) / bench.device.scale_V_s_per_rad)


def _sampled(capture: Capture, name: str, rate: Callable[[Capture], Floats]) -> Axis:
    first, last = capture.ends

    def blocks() -> Iterator[Block]:
        for piece in capture.pieces():
            yield Block(_ticks(piece), rate(piece), piece.rate_rad_s, piece.temp_C, None)

    return Axis(name, capture.tick_rate_Hz, first, last + 1 - first, first, capture.steady, blocks)


def _ticks(piece: Capture) -> Ints:
    """Those of a piece; of one without a gap they need not be read."""
    first, last = piece.ends
    return np.arange(first, last + 1) if last + 1 - first == len(piece) else piece.tick


def _whole_angle(folder: RunFolder, estimates: Estimates, truth: Truth | None) -> Axis:
    """The mean rate from one row of the estimates to the next; so is the truth's, by its own angle."""
    every = int(estimates.header["every"])
    first, last = estimates.ends
    turned = _turned(folder, truth)

    def blocks() -> Iterator[Block]:
        before: tuple[int, float, float, float] | None = None
        for piece in estimates.pieces():
            tick, angle = piece.tick, np.asarray(piece["angle_rad"], float)
            theta = _pattern(piece)
            true = None if turned is None else turned(tick)
            if before is not None:
                tick, angle = np.insert(tick, 0, before[0]), np.insert(angle, 0, before[1])
                theta = np.insert(theta, 0, before[2])
                true = None if true is None else np.insert(true, 0, before[3])
            theta = 0.5 * np.unwrap(2.0 * theta)
            seconds = np.diff(tick) / estimates.tick_rate_Hz
            reference = None if true is None else np.diff(true) / seconds
            before = int(tick[-1]), float(angle[-1]), float(theta[-1]), 0.0 if true is None else float(true[-1])
            middle = 0.5 * (theta[1:] + theta[:-1])
            known = np.isfinite(angle[1:] - angle[:-1])
            if reference is not None:
                known &= np.isfinite(reference)
            yield Block(
                (tick[1:] // every)[known], (np.diff(angle) / seconds)[known],
                None if reference is None else reference[known], None, middle[known],
            )  # fmt: skip

    # the angle has its zero where it is scored first: it steps there
    settled = int(np.ceil(folder.scored_from_s * estimates.tick_rate_Hz / every)) + 1
    return Axis(
        "angle",
        estimates.tick_rate_Hz / every,
        first // every,
        last // every - first // every + 1,
        settled,
        False,
        blocks,
    )


def _pattern(estimates: Estimates) -> Floats:
    x, vx, y, vy = (np.asarray(estimates[name], float) for name in ("x_m", "vx_mps", "y_m", "vy_mps"))
    return pattern_angle(x, vx, y, vy, float(estimates.header["target_stiffness_per_s2"]))


def _turned(folder: RunFolder, truth: Truth | None) -> Callable[[Ints], Floats] | None:
    """The device's rotation at ticks, not a number where nobody knows it."""
    if truth is not None:

        def by_truth(tick: Ints) -> Floats:
            near = truth.between(int(tick[0]) - truth.spacing, int(tick[-1]) + truth.spacing)
            angle = np.asarray(near["angle_rad"], float)
            return np.asarray(np.interp(tick, near.tick, angle, left=np.nan, right=np.nan))

        return by_truth
    capture = folder.capture
    if capture is None or (rate := capture.rate_rad_s) is None:
        beside = reference_rate(folder)
        if isinstance(beside, str) or capture is None:
            return None
        ticks_per_s = capture.tick_rate_Hz
        return lambda tick: beside.turned(tick / ticks_per_s)
    ticks = capture.tick
    steps = np.diff(ticks) / capture.tick_rate_Hz
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * steps)])
    return lambda tick: np.interp(tick, ticks, angle, left=np.nan, right=np.nan)
