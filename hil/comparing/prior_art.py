"""What the patent calls prior art, on a record that is there already: (a), (b), (c) and (e).  (d) closes the loop
itself: `hil.comparing.own_loop`.

The methods of others are plug-ins like any other, in `examples/prior-art`.
"""

from collections.abc import Callable
from functools import partial

from hil.bench import Bench, override
from hil.bench.examples import directory
from hil.comparing.course import MethodCourse
from hil.comparing.observers import course_of, integrated, with_observer
from hil.comparing.record import Given

RATE_WITHOUT_OFFSETS = "(a) rate without sense errors, integrated"
RATE_IDENTIFIED = "(a) rate by modulating functions, integrated"
WITHOUT_OFFSETS = "(c) control law without sense errors"
PLUGINS = {
    RATE_IDENTIFIED: "modulated.py:ModulatedRate",
    "(b) formula (11) on raw signals": "pattern.py:RawFormula",
    "(b) formula (11), averaged over a cycle": "pattern.py:AveragedFormula",
    "(e) Friedland–Hutton": "pattern.py:OrbitalElements",
}


def methods(given: Given) -> list[tuple[str, Callable[[], MethodCourse]]]:
    """Names, and what runs each."""
    eleven = with_observer(given.bench, "gyro", given.bench.observer.gain)
    found: dict[str, Callable[[], MethodCourse]] = {
        RATE_WITHOUT_OFFSETS: partial(integrated, given, eleven, RATE_WITHOUT_OFFSETS),
        WITHOUT_OFFSETS: partial(course_of, given, eleven, WITHOUT_OFFSETS, "prior art"),
    }
    for name, plugin in PLUGINS.items():
        found[name] = partial(course_of, given, with_plugin(given.bench, plugin), name, "prior art")
    return sorted(found.items())


def with_plugin(bench: Bench, plugin: str, *, controls: bool = False) -> Bench:
    """The bench with a plug-in of `examples/prior-art` as its observer, and as its controller if it controls."""
    named = {"plugin": str(directory() / "prior-art" / plugin)}
    changes = {"observer": named} | ({"controller": named} if controls else {})
    return override(bench, changes, bench.device.name or "bench")
