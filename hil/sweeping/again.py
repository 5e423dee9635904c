"""One run of a campaign made again, as a run folder with its report: the same bytes as in the campaign."""

import shutil
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow.compute as pc

from hil.errors import InputError
from hil.progress import Watcher
from hil.records.atomic import write_text
from hil.records.runfolder import RunFolder
from hil.report.page import write_report
from hil.running.request import request_of
from hil.running.run import run as run_loop
from hil.scoring.score import score
from hil.sweeping.columns import schema
from hil.sweeping.initial_values import with_drawn_initial_values
from hil.sweeping.kept import read_rows
from hil.sweeping.one_run import digest_of
from hil.sweeping.plan import Plan, toml_of


class Again(NamedTuple):
    """The run folder, and whether its record is that of the campaign: None where the campaign has no such row."""

    folder: Path
    same: bool | None
    told: str


def make_again(plan: Plan, number: int, out: Path, results: Path, *, progress: Watcher) -> Again:
    """Make run `number` below `out`, with its scenario and truth beside the record; `results`: the campaign's folder.

    Raises InputError where there is no such run, or it cannot begin.
    """
    planned = plan.run(number)
    scenario, _ = plan.tables(planned)
    bench = plan.bench_of(planned)
    with tempfile.TemporaryDirectory() as temporary:
        place = Path(temporary)
        board, truth = place / "board.scenario.toml", place / "truth.arrow"
        write_text(board, toml_of(scenario, f"The board of run {number} of {plan.campaign.name}."))
        if plan.campaign.each.drawn_initial:
            bench = with_drawn_initial_values(bench, board, place)
        asked: Any = {**plan.task(number).what["run"], "truth": truth}
        request = request_of(bench, asked, link=f"inproc:{board}")
        done = run_loop(request, out, report=False, progress=progress)
        assert done.folder is not None
        score(done.folder, truth)
        write_report(done.folder, truth)
        for file in (board, truth):
            shutil.move(file, done.folder / file.name)
    digest = digest_of(RunFolder(done.folder).capture_path)
    known = _digest_in(results, plan, number)
    if known is None:
        told = f"{done.folder}: the campaign has no row of run {number} to compare it with"
    elif known == digest:
        told = f"{done.folder}: its record is that of the campaign, byte for byte"
    else:
        told = f"{done.folder}: its record is NOT that of the campaign: another program, or another kind of processor"
    return Again(done.folder, None if known is None else known == digest, told)


def _digest_in(results: Path, plan: Plan, number: int) -> str | None:
    if not (results / "results").exists():
        return None
    try:
        table = read_rows(results, schema(plan.campaign))
    except (OSError, ValueError):
        raise InputError(f"{results}: holds results of another campaign; give --out of this one") from None
    rows = table.filter(pc.equal(table["run"], number))
    return rows["record_sha256"].to_pylist()[0] if len(rows) else None
