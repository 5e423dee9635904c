"""Every method on one record: its rows, its figure, its page."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from estimator.characteristics.angle_map import pattern_angle
from estimator.errors import ModelError
from estimator.model.catalogue import model_for
from estimator.rotation import rotation_bound
from estimator.scaling import Array
from estimator.settings import Variant
from hil.bench import Bench, override
from hil.bench.by_verb import of_a_record, require_usable
from hil.characterising.figures import figures_of
from hil.characterising.source import Axis, Block
from hil.comparing import observers
from hil.comparing.course import DAMPING, STIFFNESS, Given, Judge, MethodCourse, Reference, given, reference_of, rms
from hil.comparing.observers import (
    GAINS,
    STATES,
    course_of,
    name_of,
    plugin_name,
    rotation_name,
    with_observer,
    without_effects,
)
from hil.comparing.own_loop import ADAPTIVE, ON_THE_BOARD, board_course, loops_course, own_runs, require_emulated
from hil.errors import InputError
from hil.plugins.protocol import PluginError
from hil.progress import Progress, Watcher
from hil.records.atomic import require_place
from hil.records.capture import Capture
from hil.records.diagnosis import Diagnosis
from hil.records.methods import MethodRow, Methods, SheetFigures, save_methods
from hil.records.runfolder import RunFolder
from hil.records.summary import on_board
from hil.records.truth import Truth
from hil.report.methods import Line, write_report
from hil.running.run import new_folder
from hil.scoring.score import require_reach, require_same_run, truth_in
from hil.tracing.addition import additions
from hil.tracing.request import called

Floats = npt.NDArray[np.float64]
Pattern = Callable[[npt.NDArray[np.int64]], Floats]
"""The pattern's angle θ (n,) in the device's frame at ticks (n,)."""

_LEAST = 30


def pattern_of(truth: Truth, stiffness_per_s2: float) -> Pattern:
    """That of the true motion, between its rows straight."""
    x, vx, y, vy = (np.asarray(truth[name], float) for name in ("x_m", "vx_mps", "y_m", "vy_mps"))
    theta = 0.5 * np.unwrap(2.0 * pattern_angle(x, vx, y, vy, stiffness_per_s2))
    return lambda tick: np.asarray(np.interp(tick, truth.tick, theta))


def sheet_of(
    course: MethodCourse, reference: Reference, pattern: Pattern | None, rate_Hz: float, from_s: float
) -> SheetFigures:
    """Value and 95 % interval by the figure's name, SI; nothing of an angle that is not finite, or too short."""
    scored = course.tick >= from_s * rate_Hz
    tick, angle = course.tick[scored], course.angle[scored]
    if tick.size < _LEAST or not np.isfinite(angle).all():
        return {}
    every = int(np.median(np.diff(tick)))
    seconds = np.diff(tick) / rate_Hz
    true = np.diff(reference.at(tick)[0]) / seconds
    theta = None if pattern is None or course.own_record else pattern(tick)
    middle = None if theta is None else 0.5 * (theta[1:] + theta[:-1])

    def blocks() -> Iterator[Block]:
        yield Block(tick[1:] // every, np.diff(angle) / seconds, true, None, middle)

    first, last = int(tick[1] // every), int(tick[-1] // every)
    axis = Axis(course.name, rate_Hz / every, first, last + 1 - first, first, False, blocks)
    found = figures_of([axis]).found
    return {
        name: (one.value, one.low, one.high)
        for name, one in found.items()
        if name != "start_up" and np.isfinite(one[:3]).all()
    }


@dataclass(frozen=True)
class Compared:
    """Where a comparison was written (comparison.json, report.html, bench.toml), and what it came to."""

    folder: Path
    methods: Methods
    own: str
    """The row of the bench file's own observer."""

    @property
    def diverged(self) -> bool:
        return all(row.diverged_s is not None for row in self.methods.rows if row.name == self.own)


@np.errstate(all="ignore")  # a method that diverged is told by its figures, not by NumPy
def compare(
    capture: Path,
    bench: Bench,
    out: Path,
    *,
    truth: Path | None = None,
    link: str | None = None,
    diagnosis: Diagnosis | None = None,
    report: bool = True,
    progress: Watcher,
) -> Compared:
    """Run every method over the record at `capture`; a new folder below `out` has what came of it.

    truth: file that the emulated board of the record wrote, without which the record's own rate channel is the
    reference, or the commercial gyro of the run, if it has one.  link: an emulated board on which methods that close
    the loop themselves do so.  diagnosis: what a trace found on the record, to be included in the 13 states.  Raises
    InputError for a record that does not belong to the bench file or cannot be compared; nothing is left then.
    """
    require_usable(bench, "compare")
    bench = of_a_record(bench)
    place = None if link is None else require_emulated(link)
    subject = given(capture, bench)
    require_place(out)
    known = None if truth is None else truth_in(truth)
    if known is not None and truth is not None and subject.streams:
        known = known.on(subject.device.sample_rate, truth)
    remarks = list(subject.captured.told)
    if known is not None and truth is not None:
        remarks += _same(capture, subject.captured, known, truth)
    run = RunFolder(capture.parent) if capture.name == "capture.arrow" else None
    recorded = [] if run is None else [course for of in (board_course, loops_course) if (course := of(run))]
    found, lines = methods_on(
        subject, called(capture), truth=known, link=place, diagnosis=diagnosis, recorded=recorded, remarks=remarks,
        progress=progress,
    )  # fmt: skip
    if run is not None and (said := on_board(run)) is not None:
        found = found.model_copy(update={"remarks": (f"{ON_THE_BOARD}, less the host's: {said.line}", *found.remarks)})
    folder = new_folder(out, bench)
    save_methods(folder / "comparison.json", found)
    if report:
        progress(Progress("report", 0, 0))
        write_report(folder, found, lines, capture)
    plugin = subject.bench.observer.plugin
    named = name_of(bench.observer.variant, bench.observer.gain) if plugin is None else plugin_name(plugin)
    return Compared(folder, found, named)


def methods_on(
    subject: Given,
    name: str,
    *,
    truth: Truth | None,
    link: str | None,
    diagnosis: Diagnosis | None = None,
    recorded: Sequence[MethodCourse] = (),
    remarks: Sequence[str] = (),
    progress: Watcher,
) -> tuple[Methods, list[Line]]:
    """Every method on a record that is in memory and called `name`: the rows, and the errors over time; as `compare`,
    which see, with a link whose scenario is a path; recorded: what the run said while it
    was recorded, the board or the loops of a classic mode.
    """
    bench, remarks = subject.bench, list(remarks)
    reference = reference_of(subject.captured, truth, subject.beside)
    judge = Judge(subject.device.sample_rate, subject.scored_from_s, subject.device.target)
    if subject.seconds <= bench.loop.settle_s:
        raise InputError(
            f"{name}: {subject.seconds:.3g} s are over before settle_s = {bench.loop.settle_s:g} s; "
            "give a longer record, or a smaller settle_s"
        )
    pattern = None if truth is None else pattern_of(truth, subject.device.target)
    rows = _Rows(judge, progress, pattern)
    for course in recorded:
        rows.add(course.name, partial(_beside, partial(replace, course), reference))
    for title, method in _on_record(subject, diagnosis, remarks):
        rows.add(title, partial(_beside, method, reference))
    if link is None:
        remarks.append(f"{ADAPTIVE}: closes the loop itself; give the board of the record as --link inproc:SCENARIO")
    else:
        for title, run in own_runs(bench, link, subject.seconds):
            rows.add(title, run)
    remarks += rows.failed
    if bench.offset_sd_V:
        remarks.append(
            f"{STATES['gyro']} states and {observers.WITHOUT_OFFSETS}: assume that the sense offsets are zero, "
            f"but {bench.offset_sd_V:g} V are declared; their U does not include them"
        )
    if subject.streams:
        remarks.append("bound: of samples only")
    elif truth is not None:
        progress(Progress("bound", 0, 0))
        try:
            rows.done.append(bound_of(subject, truth))
        except (InputError, ModelError) as error:
            remarks.append(f"bound: {error}")
    else:
        remarks.append("bound: needs the true states; give the truth of the record's emulated board as --truth")
    found = Methods(
        record=name,
        bench=bench.device.name,
        seconds=subject.seconds,
        window_s=(judge.from_s, float(subject.samples.tick[-1] / judge.rate_Hz)),
        reference=None if reference is None else reference.name,
        rows=tuple(rows.done),
        remarks=tuple(remarks),
    )
    return found, rows.lines


class _Rows:
    """Methods run one after another; one that cannot is told in a line and left out."""

    def __init__(self, judge: Judge, progress: Watcher, pattern: Pattern | None) -> None:
        self.done: list[MethodRow] = []
        self.lines: list[Line] = []
        self.failed: list[str] = []
        self._judge, self._progress, self._pattern = judge, progress, pattern

    def add(self, name: str, method: Callable[[], tuple[MethodCourse, Reference | None]]) -> None:
        self._progress(Progress(name, 0, 0))
        try:
            course, reference = method()
            row = self._judge.row(course, reference)
            if reference is not None:
                judge = self._judge
                sheet = sheet_of(course, reference, self._pattern, judge.rate_Hz, judge.from_s)
                row = row.model_copy(update={"sheet": sheet})
            self.done.append(row)
        except (ModelError, InputError, PluginError) as error:
            self.failed.append(str(error) if str(error).startswith(name) else f"{name}: {error}")
            return
        if reference is not None:
            t_s, error_rad = self._judge.error(course, reference)
            self.lines.append(Line(name, course.kind, t_s, error_rad))


def _beside(method: Callable[[], MethodCourse], reference: Reference | None) -> tuple[MethodCourse, Reference | None]:
    return method(), reference


def _on_record(
    subject: Given, diagnosis: Diagnosis | None, remarks: list[str]
) -> list[tuple[str, Callable[[], MethodCourse]]]:
    bench = subject.bench
    found: list[tuple[str, Callable[[], MethodCourse]]] = []
    if bench.observer.plugin is not None:
        name = plugin_name(bench.observer.plugin)
        found.append((name, partial(course_of, subject, bench, name)))
    if subject.streams:
        remarks.append("demodulated streams: what reads samples within a cycle, as the 13 states, cannot be compared")
        return found
    for variant in STATES:
        for gain in GAINS:
            changed, name = with_observer(bench, variant, gain), name_of(variant, gain)
            found.append((name, partial(course_of, subject, changed, name)))
    named = rotation_name()
    found.append((named, partial(course_of, subject, with_observer(bench, "full", "ekf"), named, rotation=True)))
    if declared := [*bench.effects.named, *bench.effects.custom]:
        plain, name = with_observer(bench, "full", bench.observer.gain), name_of("full", bench.observer.gain)
        name = f"{name}, without {' and '.join(declared)}"
        found.append((name, partial(course_of, subject, without_effects(plain), name)))
    if diagnosis is not None:
        effects = effects_of(diagnosis)
        if effects:
            name = f"{name_of('full', bench.observer.gain)}, with {' and '.join(effects)}"
            traced = override(with_observer(bench, "full", bench.observer.gain), {"effects": effects}, "the trace")
            found.append((name, partial(course_of, subject, traced, name, "traced")))
        else:
            remarks.append(f"trace: {diagnosis.verdict}, so there is no effect to include")
    return [*found, *observers.methods(subject)]


def effects_of(diagnosis: Diagnosis) -> dict[str, Mapping[str, float]]:
    """[effects] as a bench file would have them after `hil trace --add`."""
    found = additions(diagnosis)
    return {one.name: {symbol: value for symbol, (value, _) in one.coefficients.items()} for one in found}


def _same(capture: Path, captured: Capture, truth: Truth, place: Path) -> list[str]:
    """Remarks where it cannot be told whether the truth is that of the record; InputError where it is not, or ends
    before the record does.
    """
    if capture.name == "capture.arrow":
        told = require_same_run(RunFolder(capture.parent), truth, place)
    else:
        told = [f"{place}: whether it is the truth of {capture} cannot be told"]
    return told + require_reach(truth, place, captured)


BOUND = "posterior Cramér–Rao bound"
_MOTION = ("x_m", "vx_mps", "y_m", "vy_mps", "phi_x_V", "phi_y_V", "rate_rad_s")


def bound_of(given: Given, truth: Truth) -> MethodRow:
    """Least deviations, rms over the scored window, of 13 states under what the bench file declares of noise, random
    walk and initial value; the angle's is that of its change since the start of the window.

    Raises InputError where the truth lacks a sample of the record.
    """
    device, settings = given.device, replace(given.settings, variant=Variant.FULL, effects={})
    every = given.bench.loop.estimate_every
    rotation, deviation = rotation_bound(
        device, settings, _states(given, truth), every=every, lost=np.isnan(given.sense)
    )
    tick = given.samples.tick[every - 1 :: every]
    scored = tick / device.sample_rate >= given.scored_from_s
    names = model_for(2)[1].names

    def end(wanted: tuple[str, ...]) -> float:
        return rms(deviation[-1, [names.index(name) for name in wanted]])

    constants = truth.constants
    return MethodRow(
        name=BOUND,
        kind="bound",
        record="this",
        angle_error_rms_rad=rms(rotation[scored]),
        angle_error_max_rad=float(np.max(rotation[scored])),
        rate_error_rms_rad_s=rms(deviation[scored, names.index("rate")]),
        stiffness_error=end(STIFFNESS) / device.target,
        damping_error=end(DAMPING) / (0.5 * (constants["dxx_per_s"] + constants["dyy_per_s"])),
        remark="under the declared noise and random walk of the rate",
    )


def _states(given: Given, truth: Truth) -> Array:
    """True state vector at every sample (n, 13)."""
    tick = given.samples.tick
    ours, theirs = truth.at(tick)
    if len(ours) != len(tick):
        raise InputError("the truth lacks samples of the record, so there is no bound; give the truth of this run")
    motion = np.column_stack([truth[name][theirs] for name in _MOTION])
    constants = truth.constants
    named = [f"{name}_per_s2" for name in STIFFNESS] + [f"{name}_per_s" for name in DAMPING]
    each = [np.full(len(tick), constants[n]) if n in constants else truth[n][theirs] for n in named]
    return np.column_stack([motion, *each])
