"""The experiment that tells apart what one record could not: run on the connected board, traced, decided."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from estimator.trace.separation import EXPERIMENTS, Experiment, experiment_called
from hil.bench import Bench, override
from hil.errors import InputError
from hil.loop.run import run
from hil.progress import Watcher
from hil.records.diagnosis import Confusable, Diagnosis
from hil.records.runfolder import RunFolder
from hil.tracing import Traced, trace

_MARGIN = 1.2  # of the energy's swing under modulation, as a limit
_LONGER = (1, 2, 4)  # times the duration of the bench file, one after another where a shorter record was in vain


@dataclass(frozen=True)
class Separated:
    """An experiment that was made: what was done, where it was recorded, what its trace came to, and the pairs that it
    told apart or did not.
    """

    experiment: str
    run: Path
    traced: Traced
    apart: tuple[Confusable, ...]
    still_alike: tuple[Confusable, ...]


def separate(
    diagnosis: Diagnosis,
    bench: Bench,
    link: str,
    out: Path,
    *,
    fraction: float | None,
    also: Sequence[str] = (),
    before_run: Callable[[Experiment, str], None],
    progress: Watcher,
) -> tuple[Separated, ...]:
    """Make the experiments that `diagnosis` proposes on the board at `link`, one after another until no pair is left.

    Where the one proposed was made and told nothing, all of them are made at once, then for longer; what is left then
    stays listed. before_run is told which will be made, and in words, before the board is armed: what no host can do,
    as to turn the gyro, is done by then.  Raises InputError or WireError as a run does.
    """
    done: list[Separated] = []
    pairs = separable(diagnosis)
    made: list[tuple[Experiment, int]] = []
    while pairs and (step := _next(pairs, made)) is not None:
        made.append(step)
        experiment, times = step
        words = experiment.words if times == 1 else f"{experiment.words}, for {times} times as long"
        before_run(experiment, words)
        changed = override(
            bench, changes(experiment, bench, times), f"the bench file with the experiment {experiment.name!r}"
        )
        folder = run(changed, link, out, note=f"experiment: {words}", progress=progress).folder
        assert folder is not None  # only a dry run leaves none
        traced = trace(RunFolder(folder).capture_path, changed, out, fraction=fraction, also=also, progress=progress)
        apart = tuple(pair for pair in pairs if not _alike(pair, traced.diagnosis))
        alike = tuple(pair for pair in pairs if _alike(pair, traced.diagnosis))
        done.append(Separated(words, folder, traced, apart, alike))
        pairs = separable(traced.diagnosis)
    return tuple(done)


def _next(pairs: list[Confusable], made: list[tuple[Experiment, int]]) -> tuple[Experiment, int] | None:
    """The experiment to make, and for how many times the duration; None where all was in vain."""
    everything = EXPERIMENTS[-1]
    steps = [(named(pairs[0].experiment or ""), 1), *((everything, times) for times in _LONGER)]
    return next((step for step in steps if step not in made), None)


def separable(diagnosis: Diagnosis) -> list[Confusable]:
    """Pairs that an experiment would tell apart which a run can make; a clock or a weight is compared by hand."""
    return [pair for pair in diagnosis.confusable if experiment_called(pair.experiment or "") is not None]


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
    given = bench.controller
    rotation = max(abs(given.virtual_rotation_rad_s), experiment.virtual * omega0)
    swing = max(given.amplitude_modulation, experiment.modulation)
    controller = {
        "virtual_rotation_rad_s": math.copysign(rotation, given.virtual_rotation_rad_s),
        "amplitude_modulation": swing,
        "dither_mps2": max(given.dither_mps2, experiment.dither * bench.device.amplitude_m * omega0**2),
        "stiffness_step": max(given.stiffness_step, experiment.stiffness),
    }
    energy = max(bench.limits.energy_error, _MARGIN * ((1.0 + swing) ** 2 - 1.0))
    name = f"{bench.loop.name.removesuffix('-trace')}-{experiment.name}"
    loop: dict[str, Any] = {"name": name}
    if times > 1:
        loop["duration_s"] = times * bench.loop.duration_s
    return {"controller": controller, "limits": {"energy_error": energy}, "loop": loop}


def _alike(pair: Confusable, diagnosis: Diagnosis) -> bool:
    """Whether the new record does not tell the pair apart either."""
    names = {pair.effect.partition(":")[0], pair.with_.partition(":")[0]}
    return any({one.effect.partition(":")[0], one.with_.partition(":")[0]} == names for one in diagnosis.confusable)
