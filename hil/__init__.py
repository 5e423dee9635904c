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
    from estimator.errors import ModelError as ModelError
    from hil.bench import Bench as Bench
    from hil.bench import RateSensorBench as RateSensorBench
    from hil.comparing.diff import Comparison as Comparison
    from hil.errors import InputError as InputError
    from hil.identifying.identify import Identified as Identified
    from hil.importing.importer import Imported as Imported
    from hil.library.campaign import Sweep as Sweep
    from hil.library.generating import generate as generate
    from hil.library.live import Block as Block
    from hil.library.live import Live as Live
    from hil.library.loading import Run as Run
    from hil.library.loading import Trace as Trace
    from hil.library.loading import load as load
    from hil.library.loading import load_trace as load_trace
    from hil.library.series import Series as Series
    from hil.library.sheets import Sheet as Sheet
    from hil.library.verbs import characterise as characterise
    from hil.library.verbs import compare as compare
    from hil.library.verbs import diff as diff
    from hil.library.verbs import dry_run as dry_run
    from hil.library.verbs import export as export
    from hil.library.verbs import identify as identify
    from hil.library.verbs import import_record as import_record
    from hil.library.verbs import load_bench as load_bench
    from hil.library.verbs import open_live
    from hil.library.verbs import record as record
    from hil.library.verbs import replay as replay
    from hil.library.verbs import run as run
    from hil.library.verbs import score as score
    from hil.library.verbs import sweep as sweep
    from hil.library.verbs import trace as trace
    from hil.plugins.protocol import Controller as Controller
    from hil.plugins.protocol import DeclaredDevice as DeclaredDevice
    from hil.plugins.protocol import Drive as Drive
    from hil.plugins.protocol import Estimate as Estimate
    from hil.plugins.protocol import Observer as Observer
    from hil.plugins.protocol import PluginError as PluginError
    from hil.plugins.protocol import TrimVoltages as TrimVoltages
    from hil.records.methods import MethodRow as MethodRow
    from hil.records.methods import Methods as Methods
    from hil.running.concluding import Interrupted as Interrupted
    from hil.wire.errors import WireError as WireError

    open = open_live

__version__: str

_OFFERED = {
    "estimator.errors": ("ModelError",),
    "hil.bench": ("Bench", "RateSensorBench"),
    "hil.comparing.diff": ("Comparison",),
    "hil.errors": ("InputError",),
    "hil.identifying.identify": ("Identified",),
    "hil.importing.importer": ("Imported",),
    "hil.library.campaign": ("Sweep",),
    "hil.library.loading": ("Run", "Trace", "load", "load_trace"),
    "hil.library.generating": ("generate",),
    "hil.library.live": ("Block", "Live"),
    "hil.library.series": ("Series",),
    "hil.library.sheets": ("Sheet",),
    "hil.library.verbs": (
        "characterise", "compare", "diff", "dry_run", "export", "identify", "import_record", "load_bench", "record",
        "replay", "run", "score", "sweep", "trace",
    ),
    "hil.plugins.protocol": (
        "Controller", "DeclaredDevice", "Drive", "Estimate", "Observer", "PluginError", "TrimVoltages",
    ),
    "hil.records.methods": ("MethodRow", "Methods"),
    "hil.running.concluding": ("Interrupted",),
    "hil.wire.errors": ("WireError",),
}  # fmt: skip
_HOMES = {name: (home, name) for home, names in _OFFERED.items() for name in names}
_HOMES["open"] = ("hil.library.verbs", "open_live")


__all__ = sorted({*_HOMES, "__version__"} - {"open"})  # of which `from hil import *` would hide the built-in
"""All that is offered besides `open`."""


if not TYPE_CHECKING:  # whose checkers would take any name for one that is there

    def __getattr__(name: str) -> Any:
        if name == "__version__":
            from importlib.metadata import version

            return version("gyrohil")
        if name not in _HOMES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        home, called = _HOMES[name]
        found = globals()[name] = getattr(import_module(home), called)
        return found


def __dir__() -> list[str]:
    return sorted([*__all__, "open"])
