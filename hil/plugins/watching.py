"""What a process says of a plug-in that does not come back, made ready before it is called."""

import ctypes
import json
import resource
from pathlib import Path
from signal import Signals

from hil.bench import Bench
from hil.plugins import native
from hil.plugins.finding import Kind, called
from hil.plugins.native import Death, Part, Watch
from hil.plugins.of_bench import plugins_of

_MORE = 1 << 30
"""Bytes of memory: twice what ends a run that grows bit by bit."""
_PARTS: dict[Kind, Part] = {"observer": Part.OBSERVE, "controller": Part.CONTROL}
_CRASHES = {Death.SEGV: Signals.SIGSEGV, Death.BUS: Signals.SIGBUS, Death.FPE: Signals.SIGFPE,
            Death.ILL: Signals.SIGILL, Death.ABRT: Signals.SIGABRT}  # fmt: skip


def watch(bench: Bench, output: int) -> None:
    """From now on a plug-in of `bench` that crashes, ends this process, or goes on for twice as long as the host waits
    for anything, is named on the descriptor `output`, in a line of JSON; one that wants more memory than a run may have
    gets none.
    """
    patience_s = 2.0 * bench.link.timeout_s
    asked = Watch(fd=output, patience_ns=round(1e9 * patience_s))
    deaths = {
        Death.BLOCKED: f"it did not come back within {patience_s:g} s; the loop's process was ended",
        Death.EXIT: "it ended the loop's process (exit)",
        Death.OVERRUN: "it wrote beyond the memory that it was lent",
    } | {death: f"it crashed ({number.name})" for death, number in _CRASHES.items()}
    for kind, name in plugins_of(bench).items():
        for death, words in deaths.items():
            line = json.dumps({"died": f"{called(kind, name)[:200]}: {words}"}) + "\n"
            asked.words[_PARTS[kind]][death].value = line.encode()
    native.library().plugin_watch(ctypes.byref(asked))
    _bound_memory()


def _bound_memory() -> None:
    """No allocation beyond what this process has by now and a gigabyte; a bound that is there already stays."""
    taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    bound, hard = resource.getrlimit(resource.RLIMIT_AS)
    if bound == resource.RLIM_INFINITY:
        resource.setrlimit(resource.RLIMIT_AS, (taken + _MORE, hard))
