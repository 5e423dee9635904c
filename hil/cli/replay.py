"""``hil replay``: today's estimator on yesterday's record."""

from typing import Annotated, Literal

import typer

import hil
from hil.cli.options import RUNS, BenchOption, CaptureArgument, Json, Name, Out

Backend = Annotated[
    Literal["c", "numpy", "filterpy"] | None,
    typer.Option("--backend", help="Compiled, or one of the slow oracles.  [default: the bench's]"),
]


def replay(
    capture: CaptureArgument,
    bench: BenchOption = None,
    out: Out = RUNS,
    name: Name = None,
    backend: Backend = None,
    json: Json = False,
) -> None:
    """Run the observer of a bench file over a record.

    The record is an imported one, or that of an earlier run. A run has its own bench file; --bench names another.
    The outcome is a new run folder.

    Examples:

    \b
      hil replay last
      hil replay runs/first --bench better.bench.toml
      hil replay silverbox.arrow --bench silverbox
      hil replay runs/first --bench s-slow --backend numpy --json
    """
    from hil.bench import load_bench
    from hil.cli.files import bench_file, capture_in
    from hil.cli.own import prepare
    from hil.cli.progress import watching
    from hil.cli.show import finish

    record = capture_in(capture)
    declared = load_bench(bench_file(bench, record, "replay"))
    prepare(declared)
    with watching("replay") as watch:
        done = hil.replay(record, declared, name=name, backend=backend, out=out, progress=watch)
    finish(done.path, as_json=json)
