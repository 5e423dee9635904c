"""A measured oscillator from its files to a trace: imported by its map, declared by its bench file."""

from dataclasses import replace
from functools import partial
from pathlib import Path

from estimator.chance import TWO_SIDED
from estimator.record import Record
from estimator.scaling import Array
from estimator.settings import Device, ObserverSettings
from estimator.trace.checks import CHECKS
from estimator.trace.chosen import Chosen, choose
from estimator.trace.free_run import TELLING, FreeRun
from estimator.trace.named import constants_of, effects_of
from estimator.trace.problem import Problem
from estimator.trace.trace import evidence_of, judge, judged_of
from estimator.trace.verdict import share_of, verdict_of
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


def confirmed(name: str, chosen: Chosen, whole: Record) -> tuple[Chosen, str, tuple[str, ...]]:
    """What was chosen, less effects that the checks take out again, on a record that begins with the part that was
    fitted; the word, as `hil trace` has it, and what speaks against more.
    """
    of, split = FreeRun(Problem(whole, *declared(name))), chosen.of.samples
    before = of.examined(constants_of(chosen.before), effects_of(chosen.before), split)
    found = judge(chosen, partial(judged_of, of, chosen, before, split))
    against = tuple(check.sentence for check in found.checks if not check.passed)
    return replace(chosen, after=found.evidence.model), found.verdict.value, against


def judged(name: str, chosen: Chosen, test: Record) -> tuple[str, tuple[str, ...]]:
    """The word on `test`, a record by itself, of what was chosen, and what speaks against it."""
    evidence = evidence_of(FreeRun(Problem(test, *declared(name)), telling=TELLING), chosen, chosen.after, None, None)
    checks = [check for checker in CHECKS for check in checker(evidence)]
    word = verdict_of(
        list(evidence.without),
        checks,
        share_of(evidence.before_ratio, evidence.floor_ratio) if evidence.without else None,
    )
    return word.value, tuple(check.sentence for check in checks if not check.passed)


def traced(record: Record, name: str, say: Say) -> Chosen:
    """Effects of a record by its free run."""

    def progress(what: str, done: int, total: int) -> None:
        say(f"{name}: {what} {done}/{total}")

    return choose(FreeRun(Problem(record, *declared(name))), progress)


def errors_on(record: Record, name: str, chosen: Chosen, *, fitted: bool = False) -> tuple[Array, Array]:
    """What free runs (n, axes) V are off on a record, before and after; NaN over its first samples, which tell their
    start, unless the record is the one that was `fitted`, with what comes after.
    """
    of = FreeRun(Problem(record, *declared(name)), telling=0 if fitted else TELLING)
    models = (chosen.before, chosen.after)
    before, after = (of.evaluate(one.layout, one.model, derivatives=False).innovation for one in models)
    return before, after


def described(chosen: Chosen) -> list[str]:
    """What was found, in Markdown: equations, coefficients with intervals, look-alikes."""
    lines = []
    of = chosen.of
    assert isinstance(of, FreeRun)
    layout, half = chosen.after.layout, TWO_SIDED * chosen.after.deviations
    for name in chosen.named:
        effect = of.effect(name)
        units = {one.name.partition(":")[0]: one.unit for one in effect.coefficients}
        units |= {one.name: one.unit for one in effect.parameters}
        parts = []
        for k in layout.of(name):
            value, wide = (
                float(chosen.after.model.theta[k] * layout.factor[k]),
                float(half[k] * abs(layout.factor[k])),
            )
            label, unit = layout.names[k], units[layout.names[k].partition(":")[0]]
            parts.append(f"{label} = {value:.5g} [{value - wide:.5g}, {value + wide:.5g}] {unit}")
        force = " , ".join(f"+ {e}" for e in (*effect.force, *effect.sense) if e != 0)
        lines.append(f"- **{name}** (`{force}`): {'; '.join(parts)}")
        lines += [
            f"- {name} and {one.name} look alike on this record (likeness {one.likeness:.4f})"
            for one in chosen.groups[name]
        ]
    return ["\n".join(lines)] if lines else ["Nothing was added."]
