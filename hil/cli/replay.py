"""``hil replay``: today's estimator on yesterday's record."""

from typing import Annotated, Literal

import typer

from hil.cli.options import RUNS, BenchOption, CaptureArgument, Json, Name, Out

Backend = Annotated[
    Literal["numba", "numpy", "filterpy"] | None,
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

    The record is an imported one or that of an earlier run, whose own bench file is taken unless --bench names another;
    the outcome is a new run folder.

    Examples:

    \b
      hil replay last
      hil replay runs/first --bench better.bench.toml
      hil replay silverbox.arrow --bench silverbox
      hil replay runs/first --bench s-slow --backend numpy --json
    """
    from hil.bench import load_bench, override
    from hil.cli.files import bench_file, capture_in
    from hil.cli.own import prepare
    from hil.cli.progress import watching
    from hil.cli.show import finish
    from hil.replaying import replay as replay_record

    record = capture_in(capture)
    path = bench_file(bench, record, "replay")
    declared = load_bench(path)
    declared = override(declared, {"loop": {"name": name or f"{declared.loop.name}-replay"}}, str(path))
    prepare(declared)
    with watching("replay") as watch:
        done = replay_record(record, declared, out, backend=backend, progress=watch)
    assert done.folder is not None  # only a dry run leaves none
    finish(done.folder, as_json=json)
