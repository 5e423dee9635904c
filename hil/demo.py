"""The whole bench once over, on a board with an effect that nobody told the host of: run, trace, add, run again."""

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from hil import examples
from hil.bench import Bench, load_bench, override
from hil.progress import Progress, Watcher

EXAMPLE = "s-undeclared"
LOOP = {"duration_s": 12.0, "settle_s": 4.0}
"""Of its two runs, unless another duration is asked for: enough to find the effect, and to see the angle without it."""
GAIN_MODE_EXAMPLE = "s-modern-5k"


class Circle(NamedTuple):
    """Run folder without the effect, trace folder, run folder with it; None where the trace found nothing to add, or
    there was none: then `untraced` says why."""

    before: Path
    trace: Path | None
    after: Path | None
    untraced: str = ""


def demo(
    out: Path, *, name: str = "demo", duration_s: float | None = None, seed: int | None = None, progress: Watcher
) -> Circle:
    """Close the loop in paced real time over a pty, trace the record, and close it again with what was found.

    The second run's result.json has the diagnosis, its report both runs.  Each board writes its truth into a temporary
    file, which only the score reads.  `hil.errors.InputError` or `hil.wire.errors.WireError` when board or bench cannot
    be had.
    """
    from hil.addition import add_effects, additions
    from hil.errors import InputError
    from hil.records.result import load_result, save_result
    from hil.records.runfolder import RunFolder
    from hil.report.page import write_report
    from hil.tracing import trace

    path = examples.find("bench", EXAMPLE)
    options = _lasting(duration_s, LOOP), seed
    with tempfile.TemporaryDirectory() as aside:
        truths = Path(aside) / "before.arrow", Path(aside) / "after.arrow"
        before = _run(_bench(path, f"{name}-before", *options), EXAMPLE, out, truths[0], progress, report=False)
        record = RunFolder(before).capture_path
        try:  # where the machine was far too busy, a run ends early, or too little of its record is left
            _score(before, truths[0], progress)
            traced = trace(record, _bench(path, f"{name}-trace", *options), out, progress=progress)
        except InputError as error:
            if not RunFolder(before).report_path.exists():
                progress(Progress("report", 0, 0))
                write_report(before, truths[0])
            return Circle(before, None, None, str(error))
        found = additions(traced.diagnosis)
        after: Path | None = None
        if found:
            completed = traced.folder / "completed.bench.toml"
            add_effects(path, completed, found)
            after = _run(_bench(completed, name, *options), EXAMPLE, out, truths[1], progress, report=False)
            _score(after, truths[1], progress)
        last = RunFolder(after or before)
        diagnosis = traced.diagnosis.model_dump(mode="json", by_alias=True)
        save_result(last.result_path, load_result(last.result_path).model_copy(update={"diagnosis": diagnosis}))
        progress(Progress("report", 0, 0))
        write_report(before, truths[0])
        if after is not None:
            write_report(after, truths[1], earlier=(before, truths[0]))
    return Circle(before, traced.folder, after)


def in_gain_mode(
    out: Path, *, name: str = "demo", duration_s: float | None = None, seed: int | None = None, progress: Watcher
) -> Path:
    """One run, scored and reported, of a 5 kHz gyro at 100 kS/s, whose board closes the loop with the host's matrices;
    its folder.  Errors as of `demo`.
    """
    from hil.report.page import write_report

    path = examples.find("bench", GAIN_MODE_EXAMPLE)
    with tempfile.TemporaryDirectory() as aside:
        truth = Path(aside) / "truth.arrow"
        bench = _bench(path, name, _lasting(duration_s, {}), seed)
        folder = _run(bench, GAIN_MODE_EXAMPLE, out, truth, progress, report=False)
        _score(folder, truth, progress)
        progress(Progress("report", 0, 0))
        write_report(folder, truth)
    return folder


def _lasting(duration_s: float | None, usual: Mapping[str, float]) -> Mapping[str, float]:
    """Keys of [loop]: the duration asked for, else what is usual."""
    return usual if duration_s is None else {"duration_s": duration_s}


def _bench(source: Path, name: str, loop: Mapping[str, float], seed: int | None) -> Bench:
    changes: dict[str, Any] = {"name": name, "clock": "paced", "seed": seed, **loop}
    # The board is an emulated one, which nothing can harm: a busy machine shall not end the demonstration.
    return override(
        load_bench(source), {"loop": changes, "limits": {"rearm": 1000}}, f"{source} with the options given"
    )


def _run(bench: Bench, scenario: str, out: Path, truth: Path, progress: Watcher, *, report: bool = True) -> Path:
    """A run against an example's board in its own process; without `report` its page is drawn after the score."""
    from hil.loop.run import run

    link = f"pty:{examples.find('scenario', scenario)}"
    folder = run(bench, link, out, truth=truth, report=report, progress=progress).folder
    assert folder is not None  # only a dry run leaves none
    return folder


def _score(run: Path, truth: Path, progress: Watcher) -> None:
    """Raises InputError for a run that ended too early for it, which has its page then."""
    from hil.errors import InputError
    from hil.report.page import write_report
    from hil.scoring import score

    progress(Progress("score", 0, 0))
    try:
        score(run, truth)
    except InputError:
        progress(Progress("report", 0, 0))
        write_report(run, truth)
        raise
