"""The bench as a library: `import hil` in a notebook or a script.

    import hil

    run = hil.run("s-slow", link="inproc:s-slow", clock="lockstep", duration_s=5)
    run.angle.values, run.rate.values, run.verdict
    trace = hil.trace(run)
    better = trace.add_to(run.bench)

Nothing is loaded before it is asked for: the emulator and the wire import this package and stay light.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from estimator.errors import ModelError
    from hil.bench import Bench, RateSensorBench
    from hil.comparing.diff import Comparison
    from hil.errors import InputError
    from hil.importing.importer import Imported
    from hil.library.campaign import Sweep
    from hil.library.finished_run import Run
    from hil.library.generating import generate
    from hil.library.live import Block, Live
    from hil.library.loading import load, load_trace
    from hil.library.series import Series
    from hil.library.tracing import Trace
    from hil.library.verbs import (
        compare,
        diff,
        dry_run,
        export,
        import_record,
        load_bench,
        open_live,
        record,
        replay,
        run,
        score,
        sweep,
        trace,
    )
    from hil.loop.run import Interrupted
    from hil.plugins.errors import PluginError
    from hil.plugins.protocol import Controller, DeclaredDevice, Drive, Estimate, Observer
    from hil.records.methods import MethodRow, Methods
    from hil.wire.errors import WireError

    open = open_live

__all__ = [
    "Bench",
    "Block",
    "Comparison",
    "Controller",
    "DeclaredDevice",
    "Drive",
    "Estimate",
    "Imported",
    "InputError",
    "Interrupted",
    "Live",
    "MethodRow",
    "Methods",
    "ModelError",
    "Observer",
    "PluginError",
    "RateSensorBench",
    "Run",
    "Series",
    "Sweep",
    "Trace",
    "WireError",
    "__version__",
    "compare",
    "diff",
    "dry_run",
    "export",
    "generate",
    "import_record",
    "load",
    "load_bench",
    "load_trace",
    "record",
    "replay",
    "run",
    "score",
    "sweep",
    "trace",
]

__version__: str

_HOMES = {
    "Bench": "hil.bench",
    "Block": "hil.library.live",
    "Comparison": "hil.comparing.diff",
    "Controller": "hil.plugins.protocol",
    "DeclaredDevice": "hil.plugins.protocol",
    "Drive": "hil.plugins.protocol",
    "Estimate": "hil.plugins.protocol",
    "Imported": "hil.importing.importer",
    "InputError": "hil.errors",
    "Interrupted": "hil.loop.run",
    "Live": "hil.library.live",
    "MethodRow": "hil.records.methods",
    "Methods": "hil.records.methods",
    "ModelError": "estimator.errors",
    "Observer": "hil.plugins.protocol",
    "PluginError": "hil.plugins.errors",
    "RateSensorBench": "hil.bench",
    "Run": "hil.library.finished_run",
    "Series": "hil.library.series",
    "Sweep": "hil.library.campaign",
    "Trace": "hil.library.tracing",
    "WireError": "hil.wire.errors",
    "compare": "hil.library.verbs",
    "diff": "hil.library.verbs",
    "dry_run": "hil.library.verbs",
    "export": "hil.library.verbs",
    "generate": "hil.library.generating",
    "import_record": "hil.library.verbs",
    "load": "hil.library.loading",
    "load_bench": "hil.library.verbs",
    "load_trace": "hil.library.loading",
    "open": "hil.library.verbs:open_live",
    "record": "hil.library.verbs",
    "replay": "hil.library.verbs",
    "run": "hil.library.verbs",
    "score": "hil.library.verbs",
    "sweep": "hil.library.verbs",
    "trace": "hil.library.verbs",
}


if not TYPE_CHECKING:  # whose checkers would take any name for one that is there

    def __getattr__(name: str) -> Any:
        if name == "__version__":
            from importlib.metadata import version

            return version("gyrohil")
        if name not in _HOMES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        home, _, called = _HOMES[name].partition(":")
        found = globals()[name] = getattr(import_module(home), called or name)
        return found


def __dir__() -> list[str]:
    return sorted([*__all__, "open"])
