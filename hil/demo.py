"""The whole bench once over, on a board with an effect that nobody told the host of: run, trace, add, run again.

What the emulated board is started with comes from what this machine holds, measured first (`hil.running.rehearsal`).
"""

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from hil.bench import Bench, examples, load_bench, override
from hil.progress import Progress, Watcher
from hil.records.result import Result, load_result, save_result
from hil.records.runfolder import RunFolder
from hil.running.rehearsal import Started, after_late, measured

EXAMPLE = "s-undeclared"
LOOP = {"duration_s": 12.0, "settle_s": 4.0}
"""Of its two runs, unless another duration is asked for: enough to find the effect, and to see the angle without it."""
GAIN_MODE_EXAMPLE = "s-modern-5k"


class UnderTest(NamedTuple):
    """What a demonstration is to show, and whether it did."""

    words: str
    held: bool


class Circle(NamedTuple):
    """Run folder without the effect, trace folder, run folder with it; None where the trace found nothing to add, or
    there was none: then `untraced` says why. `told` is what the boards were started with and why, a line each.
    """

    before: Path
    trace: Path | None
    after: Path | None
    told: tuple[str, ...]
    untraced: str = ""

    @property
    def last(self) -> Path:
        """The last run's folder."""
        return self.after or self.before

    @property
    def under_test(self) -> tuple[UnderTest, ...]:
        """Of the whole circle."""
        from hil.records.diagnosis import load_diagnosis

        runs = [load_result(RunFolder(run).result_path) for run in (self.before, self.after) if run is not None]
        found = None if self.trace is None else load_diagnosis(self.trace / "diagnosis.json")
        explained = found is not None and found.verdict == "explained" and self.after is not None
        names = [] if found is None else [effect.title for effect in found.effects]
        errors = [result.angle_error_rms_rad for result in runs]
        return (
            _safe(*runs),
            UnderTest(f"the trace explains the residual: {', '.join(names) or 'nothing found'}", explained),
            UnderTest(_before_and_after(errors), _smaller(errors) and _good(runs[-1], "angle")),
            UnderTest("with it the model is complete", explained and _complete(runs[-1])),
        )


class Single(NamedTuple):
    """The folder of a demonstration of one run; `told` as of `Circle`."""

    last: Path
    told: tuple[str, ...]

    @property
    def under_test(self) -> tuple[UnderTest, ...]:
        """Of the run."""
        result = load_result(RunFolder(self.last).result_path)
        error = result.angle_error_rms_rad
        return (
            _safe(result),
            UnderTest(
                f"angle error {_angle(error)}, within its uncertainty", error is not None and _good(result, "angle")
            ),
            UnderTest("the model is complete", _complete(result)),
        )


def demo(
    out: Path, *, name: str = "demo", duration_s: float | None = None, seed: int | None = None, progress: Watcher
) -> Circle:
    """Close the loop in real time over a pty, trace the record, and close it again with what was found.

    The second run's result.json has the diagnosis, its report both runs.  Each board writes its truth into a temporary
    file, which only the score reads.  `hil.errors.InputError` or `hil.wire.errors.WireError` when board or bench cannot
    be had.
    """
    from hil.errors import InputError
    from hil.report.page import write_report
    from hil.tracing.addition import add_effects, additions
    from hil.tracing.request import request_of
    from hil.tracing.trace import trace

    path = examples.find("bench", EXAMPLE)
    options = _lasting(duration_s, LOOP), seed
    with tempfile.TemporaryDirectory() as aside:
        runs = _Runs(EXAMPLE, out, Path(aside), progress)
        before, truth = runs.run(_bench(path, f"{name}-before", *options))
        record = RunFolder(before).capture_path
        try:  # where the machine was far too busy, a run ends early, or too little of its record is left
            _score(before, truth, progress)
            wanted = request_of(record, _bench(path, name, *options), {"name": f"{name}-trace"})
            traced = trace(wanted, out, progress=progress)
        except InputError as error:
            if not RunFolder(before).report_path.exists():
                progress(Progress("report", 0, 0))
                write_report(before, truth)
            return Circle(before, None, None, tuple(runs.told), str(error))
        found = additions(traced.diagnosis)
        after: Path | None = None
        if found:
            completed = traced.folder / "completed.bench.toml"
            add_effects(path, completed, found)
            after, after_truth = runs.run(_bench(completed, name, *options))
            _score(after, after_truth, progress)
        last = RunFolder(after or before)
        diagnosis = traced.diagnosis.model_dump(mode="json", by_alias=True)
        save_result(last.result_path, load_result(last.result_path).model_copy(update={"diagnosis": diagnosis}))
        progress(Progress("report", 0, 0))
        write_report(before, truth)
        if after is not None:
            write_report(after, after_truth, earlier=(before, truth))
    return Circle(before, traced.folder, after, tuple(runs.told))


def in_gain_mode(
    out: Path, *, name: str = "demo", duration_s: float | None = None, seed: int | None = None, progress: Watcher
) -> Single:
    """One run, scored and reported, of a 5 kHz gyro at 100 kS/s, whose board closes the loop with the host's matrices.
    Errors as of `demo`.
    """
    from hil.report.page import write_report

    path = examples.find("bench", GAIN_MODE_EXAMPLE)
    with tempfile.TemporaryDirectory() as aside:
        runs = _Runs(GAIN_MODE_EXAMPLE, out, Path(aside), progress)
        folder, truth = runs.run(_bench(path, name, _lasting(duration_s, {}), seed))
        _score(folder, truth, progress)
        progress(Progress("report", 0, 0))
        write_report(folder, truth)
    return Single(folder, tuple(runs.told))


def _lasting(duration_s: float | None, usual: Mapping[str, float]) -> Mapping[str, float]:
    """Keys of [loop]: the duration asked for, else what is usual."""
    return usual if duration_s is None else {"duration_s": duration_s}


def _bench(source: Path, name: str, loop: Mapping[str, float], seed: int | None) -> Bench:
    changes: dict[str, Any] = {"name": name, "clock": "paced", "seed": seed, **loop}
    # The board is an emulated one, which nothing can harm: a busy machine shall not end the demonstration.
    return override(
        load_bench(source), {"loop": changes, "limits": {"rearm": 1000}}, f"{source} with the options given"
    )


class _Runs:
    """Runs against an example's board, each in processes of its own: the first is preceded by a measurement of what the
    machine holds, and one that was late all the same is repeated once with the next choice. `told` says so.
    """

    def __init__(self, scenario: str, out: Path, aside: Path, progress: Watcher) -> None:
        self._link = f"pty:{examples.find('scenario', scenario)}"
        self._out, self._aside, self._progress = out, aside, progress
        self._started: Started | None = None
        self._made = 0
        self.told: list[str] = []

    def run(self, bench: Bench) -> tuple[Path, Path]:
        """Folder and truth file of a run, whose page is drawn after the score."""
        if self._started is None:
            self._start(measured(bench, self._link, self._progress))
        folder, truth = self._once(bench)
        assert self._started is not None
        if (better := after_late(RunFolder(folder), bench, self._started)) is not None:
            from hil.report.page import write_report

            write_report(folder, truth)
            self._start(better)
            folder, truth = self._once(bench)
        return folder, truth

    def _start(self, started: Started) -> None:
        self._started = started
        self.told.append(started.words)
        self._progress(Progress("fit", 0, 0, note=started.words))

    def _once(self, bench: Bench) -> tuple[Path, Path]:
        from hil.running.request import RunRequest
        from hil.running.run import run

        assert self._started is not None
        self._made += 1
        truth = self._aside / f"truth-{self._made}.arrow"
        request = RunRequest(self._started.bench(bench), self._started.link(self._link), {"truth": truth})
        folder = run(request, self._out, report=False, progress=self._progress).folder
        assert folder is not None  # only a dry run leaves none
        place = RunFolder(folder).result_path
        result = load_result(place)
        save_result(place, result.model_copy(update={"remarks": (*result.remarks, self._started.words)}))
        return folder, truth


def _score(run: Path, truth: Path, progress: Watcher) -> None:
    """Raises InputError for a run that ended too early for it, which has its page then."""
    from hil.errors import InputError
    from hil.report.page import write_report
    from hil.scoring.score import score

    progress(Progress("score", 0, 0))
    try:
        score(run, truth)
    except InputError:
        progress(Progress("report", 0, 0))
        write_report(run, truth)
        raise


def _safe(*results: Result) -> UnderTest:
    boards = "the board" if len(results) == 1 else "both boards"
    return UnderTest(f"{boards} confirmed SAFE", all(_good(result, "safety") for result in results))


def _good(result: Result, part: Any) -> bool:
    return part in result.parts and not result.parts[part].against and result.parts[part].outcome != "unknown"


def _complete(result: Result) -> bool:
    return "model" in result.parts and result.parts["model"].outcome == "complete"


def _smaller(errors: list[float | None]) -> bool:
    before, after = errors[0], errors[-1]
    return len(errors) == 2 and before is not None and after is not None and after < before


def _before_and_after(errors: list[float | None]) -> str:
    if len(errors) < 2:
        return f"angle error {_angle(errors[0])} before; there is no run after it"
    return f"angle error {_angle(errors[0])} before, {_angle(errors[1])} after and within its uncertainty"


def _angle(size_rad: float | None) -> str:
    from hil.numbers import quantity

    return "not known" if size_rad is None else quantity(size_rad, "rad", 2)
