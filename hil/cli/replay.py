"""``hil replay``: the estimator of today on an existing record."""

from typing import Unpack

import hil
from hil.cli.options import RUNS, BenchOption, CaptureArgument, Json, Out, with_options
from hil.replaying.options import ReplayOptions


@with_options(ReplayOptions)
def replay(
    capture: CaptureArgument,
    bench: BenchOption = None,
    out: Out = RUNS,
    json: Json = False,
    **options: Unpack[ReplayOptions],
) -> None:
    """Run the observer of a bench file over a record.

    The record is an imported one, or that of an earlier run. A run has its own bench file; --bench names another. The
    result is a new run folder.

    Examples:

    \b
      hil replay last
      hil replay runs/first --bench better.bench.toml
      hil replay silverbox.arrow --bench silverbox
      hil replay runs/first --bench s-slow --backend numpy --json
    """
    from hil.bench import load_bench
    from hil.cli.consent import prepare
    from hil.cli.options import bench_file, capture_in
    from hil.cli.progress import watching
    from hil.cli.show import finish

    record = capture_in(capture)
    declared = load_bench(bench_file(bench, record, "replay"))
    prepare(declared)
    with watching("replay") as watch:
        done = hil.replay(record, declared, out=out, progress=watch, **options)
    finish(done.path, as_json=json)
