"""A measured oscillator from its files to a trace: imported by its map, declared by its bench file."""

from pathlib import Path

from estimator.identification.problem import Problem
from estimator.record import Record
from estimator.settings import Device, ObserverSettings
from estimator.trace import free_run
from estimator.trace.by_simulation import SimulationTrace, trace_by_simulation
from evaluation.measured.outcome import Say
from hil.bench import examples, load_bench
from hil.importing.importer import import_record
from hil.inputs.captured import samples_of
from hil.inputs.declared import device_of, observer_settings_of
from hil.records.capture import Capture


def imported(source: Path, work: Path, map_name: str, *, nonuniform: bool = False) -> Capture:
    """The record at `source` as a capture in the folder `work`."""
    target = work / f"{map_name}-{source.name.partition('.')[0]}.arrow"
    return import_record(source, target, map_file=examples.find("map", map_name), nonuniform=nonuniform)


def declared(name: str) -> tuple[Device, ObserverSettings]:
    """Device and observer of an example bench file."""
    bench = load_bench(examples.find("bench", name))
    return device_of(bench), observer_settings_of(bench)


def record_of(capture: Capture) -> Record:
    """A capture as numbers."""
    samples = samples_of(capture)
    return Record(samples.sense, samples.drive, samples.step)


def judged(record: Record, name: str, trace: SimulationTrace, test: Record) -> tuple[str, tuple[str, ...]]:
    """The word on `test` of what was found on `record`, as `hil trace` has it, and what speaks against it."""
    verdict, against = free_run.judged(free_run.claimed(Problem(record, *declared(name)), trace, test))
    return verdict.value, against


def traced(record: Record, name: str, skip: int, say: Say) -> SimulationTrace:
    """Effects of a record by its free run."""
    device, settings = declared(name)

    def progress(what: str, done: int, total: int) -> None:
        say(f"{name}: {what} {done}/{total}")

    return trace_by_simulation(Problem(record, device, settings), skip, progress)


def described(trace: SimulationTrace) -> list[str]:
    """What was found, in Markdown: equations, coefficients with intervals, look-alikes, what was left out."""
    lines = []
    for number, effect in trace.observer.effects:
        del number
        if effect.name not in trace.effects:
            continue
        parts = []
        for coefficient in effect.coefficients:
            low, high = trace.after.interval(coefficient.name)
            value = trace.after.value(coefficient.name)
            parts.append(f"{coefficient.name} = {value:.5g} [{low:.5g}, {high:.5g}] {coefficient.unit}")
        force = " , ".join(f"+ {e}" for e in (*effect.force, *effect.sense) if e != 0)
        lines.append(f"- **{effect.name}** (`{force}`): {'; '.join(parts)}; evidence {trace.evidence[effect.name]:.0f}")
    for taken, other, correlation in trace.alike:
        lines.append(f"- {taken} and {other} look alike on this record (correlation {correlation:.4f})")
    for name, reason in trace.rejected.items():
        if reason.startswith("fits"):
            lines.append(f"- left out: {name}, which {reason}")
    return ["\n".join(lines)] if lines else ["Nothing was added."]
