"""The experiment that tells apart what one record could not: run on the connected board, traced, decided."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from estimator.trace.experiments import (
    MODULATION,
    STEPPING,
    Experiment,
    Turn,
    amplitude_held,
    experiment_called,
    in_words,
    turn_for,
)
from hil.bench import Bench, override
from hil.errors import InputError
from hil.progress import Watcher
from hil.records.diagnosis import Diagnosis, Separation
from hil.records.runfolder import RunFolder
from hil.running.request import RunRequest
from hil.running.run import run
from hil.tracing.options import TraceOptions
from hil.tracing.request import Traced, request_of
from hil.tracing.trace import trace

_MARGIN = 1.2  # of the energy's swing under modulation, as a limit
_TIMES = (1, 2, 4)  # times the duration of the bench file that an experiment may last


class Asked(NamedTuple):
    """An experiment as it is to be made: how many times the duration of the bench file it lasts, how the gyro is turned
    where it is, and all of it in words.
    """

    experiment: Experiment
    times: int
    turn: Turn
    words: str


@dataclass(frozen=True)
class Separated:
    """An experiment that was made: what was done, where it was recorded, what its trace came to, and the pairs that it
    told apart or did not; where its record is refused, as one that is clipped, there is no trace, and why.
    """

    experiment: str
    run: Path
    traced: Traced | None
    apart: tuple[Separation, ...]
    still_alike: tuple[Separation, ...]
    refused: str | None = None


def separate(
    diagnosis: Diagnosis,
    bench: Bench,
    link: str,
    out: Path,
    *,
    options: TraceOptions,
    before_run: Callable[[Asked], None],
    progress: Watcher,
) -> tuple[Separated, ...]:
    """Make the experiments that `diagnosis` proposes on the board at `link`, one after another until no pair is left.

    Each lasts as long as it takes, in whole durations of the bench file.  Where the one proposed was made and told
    nothing, all of them are made at once, then for longer; what is left then stays listed.  Where the record of a
    modulated amplitude is refused, the amplitude is left alone from then on.  options: of the traces.  before_run is
    told what will be made before the board is armed: what no host can do, as to turn the gyro, is done by then.  Raises
    InputError or WireError as a run does.
    """
    done: list[Separated] = []
    pairs = separable(diagnosis, bench)
    made: list[tuple[Experiment, int]] = []
    held = False
    while pairs and (step := _next(pairs, bench, made, held=held)) is not None:
        made.append(step)
        asked = asked_for(*step, bench)
        before_run(asked)
        changed = override(
            bench,
            changes(asked.experiment, bench, asked.times),
            f"the bench file with the experiment {asked.experiment.name!r}",
        )
        folder = run(RunRequest(changed, link, {"note": f"experiment: {asked.words}"}), out, progress=progress).folder
        assert folder is not None  # only a dry run leaves none
        capture = RunFolder(folder).capture_path
        try:
            wanted = request_of(capture, changed, {**options, "name": changed.loop.name})
            traced = trace(wanted, out, progress=progress)
        except InputError as refusal:
            held = held or asked.experiment.modulation > 0.0
            done.append(Separated(asked.words, folder, None, (), tuple(pairs), str(refusal)))
            continue
        apart = tuple(pair for pair in pairs if not _alike(pair, traced.diagnosis))
        alike = tuple(pair for pair in pairs if _alike(pair, traced.diagnosis))
        done.append(Separated(asked.words, folder, traced, apart, alike))
        pairs = separable(traced.diagnosis, bench)
    return tuple(done)


def last_traced(made: Sequence[Separated]) -> Traced | None:
    return next((one.traced for one in reversed(made) if one.traced is not None), None)


def asked_for(experiment: Experiment, times: int, bench: Bench) -> Asked:
    """How an experiment is to be made on a bench, for so many times its duration."""
    duration = bench.loop.duration_s
    wander = bench.observer.process_noise.rate_rad_s_per_rts
    turn = turn_for(math.sqrt(bench.target_stiffness_per_s2), wander, duration)
    words = in_words(experiment, turn)
    return Asked(experiment, times, turn, words if times == 1 else f"{words}; for {times * duration:g} s")


def _next(
    pairs: list[Separation], bench: Bench, made: list[tuple[Experiment, int]], *, held: bool
) -> tuple[Experiment, int] | None:
    """The experiment to make, and for how many times the duration; None where all was in vain.  held: the amplitude is
    left alone.

    What is made later does all that was made before: else it may leave alike again what that told apart.
    """
    first = pairs[0]
    least = next(times for times in _TIMES if _long_enough(first, times, bench))
    proposed = named(first.experiment or "")
    turned = proposed.turning or any(experiment.turning for experiment, _ in made)
    still, all_of_them = (amplitude_held(named(name)) if held else named(name) for name in ("together", "all"))
    steps = [] if made else [(proposed, least)]
    if not turned:
        steps.append((still, least))
    everything = all_of_them if _follows_turns(bench) else still
    longest = max((times for experiment, times in made if experiment == everything), default=0)
    steps += [(everything, times) for times in _TIMES if times >= least and times > longest]
    return next((step for step in steps if step not in made), None)


def separable(diagnosis: Diagnosis, bench: Bench) -> list[Separation]:
    """Pairs that an experiment would tell apart which a run of this bench can make, of four times its duration at most;
    a clock or a weight is compared by hand.
    """
    pairs = [pair for pair in within_reach(diagnosis) if _long_enough(pair, _TIMES[-1], bench)]
    return [pair for pair in pairs if _follows_turns(bench) or not named(pair.experiment or "").turning]


def within_reach(diagnosis: Diagnosis) -> list[Separation]:
    """The same of a run however long."""
    return [pair for pair in diagnosis.separations if experiment_called(pair.experiment or "") is not None]


def duration_for(pair: Separation) -> float:
    """`[loop] duration_s` with which `separable` has a pair, s."""
    return (pair.takes_s or 0.0) / _TIMES[-1]


def _follows_turns(bench: Bench) -> bool:
    """Whether the observer lets the rate change at all."""
    return bench.observer.process_noise.rate_rad_s_per_rts > 0.0


def _long_enough(pair: Separation, times: int, bench: Bench) -> bool:
    return (pair.takes_s or 0.0) <= times * bench.loop.duration_s


def named(name: str) -> Experiment:
    """The experiment of that name. InputError for one that this bench cannot make."""
    if (experiment := experiment_called(name)) is None:
        raise InputError(f"experiment {name!r}: not one that a run can make; make it by hand and trace the record")
    return experiment


def changes(experiment: Experiment, bench: Bench, times: int = 1) -> dict[str, dict[str, Any]]:
    """The experiment in keys of the bench file, for so many times its duration; what the bench file does already stays
    where it is more.
    """
    omega0 = math.sqrt(bench.target_stiffness_per_s2)
    frequency_Hz = omega0 / (2.0 * math.pi)
    given = bench.controller
    rotation = max(abs(given.virtual_rotation_rad_s), experiment.virtual * omega0)
    swing = max(given.amplitude_modulation, experiment.modulation)
    controller = {
        "virtual_rotation_rad_s": math.copysign(rotation, given.virtual_rotation_rad_s),
        "amplitude_modulation": swing,
        "dither_mps2": max(given.dither_mps2, experiment.dither * bench.device.amplitude_m * omega0**2),
        "stiffness_step": max(given.stiffness_step, experiment.stiffness),
    }
    if experiment.modulation > given.amplitude_modulation:
        controller["modulation_Hz"] = frequency_Hz / MODULATION
    if experiment.stiffness > given.stiffness_step:
        controller["stiffness_step_Hz"] = frequency_Hz / STEPPING
    energy = max(bench.limits.energy_error, _MARGIN * ((1.0 + swing) ** 2 - 1.0))
    name = f"{bench.loop.name.removesuffix('-trace')}-{experiment.name}"
    loop: dict[str, Any] = {"name": name}
    if times > 1:
        loop["duration_s"] = times * bench.loop.duration_s
    return {"controller": controller, "limits": {"energy_error": energy}, "loop": loop}


def _alike(pair: Separation, diagnosis: Diagnosis) -> bool:
    """Whether the new record does not tell the pair apart either."""
    names = {pair.effect.partition(":")[0], pair.with_.partition(":")[0]}
    return any({one.effect.partition(":")[0], one.with_.partition(":")[0]} == names for one in diagnosis.separations)
