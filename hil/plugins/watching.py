"""What a process says of a plug-in that does not come back, made ready before it is called."""

import ctypes
import json
from signal import Signals

from hil.bench import Bench
from hil.plugins import native
from hil.plugins.finding import Kind, called
from hil.plugins.native import Death, Part, Watch
from hil.plugins.of_bench import plugins_of

_OUTPUT = 1
_PARTS: dict[Kind, Part] = {"observer": Part.OBSERVE, "controller": Part.CONTROL}
_CRASHES = {Death.SEGV: Signals.SIGSEGV, Death.BUS: Signals.SIGBUS, Death.FPE: Signals.SIGFPE,
            Death.ILL: Signals.SIGILL, Death.ABRT: Signals.SIGABRT}  # fmt: skip


def watch(bench: Bench, patience_s: float) -> None:
    """From now on a plug-in of `bench` that crashes, ends this process or goes on for longer than `patience_s` is named
    on standard output, in a line of JSON.
    """
    asked = Watch(fd=_OUTPUT, patience_ns=round(1e9 * patience_s))
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
