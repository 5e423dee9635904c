"""Plug-ins tried before a board is armed: on the declared device, in its loop, with what they say checked as in a run.

What they do wrong at once is found here, and how many samples a second one in Python holds.
"""

import ctypes
import json
import resource
import time
from pathlib import Path
from signal import Signals

import numpy as np

from estimator.declared_loop import DeclaredLoop
from estimator.observer import Observer
from hil.bench import Bench
from hil.errors import InputError
from hil.inputs.captured import declared_electrodes
from hil.inputs.declared import board_device_of, controller_settings_of, observer_settings_of
from hil.numbers import quantity
from hil.plugins import native
from hil.plugins.finding import Kind, called
from hil.plugins.native import Death, Part, Watch
from hil.plugins.of_bench import loop_observer, plugins_of
from hil.plugins.plugged import Plugged
from hil.wire.messages import Identity

_SAMPLES, _QUIET = 600, 100
_LATE = 99.0  # percentile that has to come in time


def tried(bench: Bench, identity: Identity) -> list[str]:
    """A remark for each plug-in in Python: the rate that it holds.

    Raises InputError where one cannot be used, or is too slow for a board on wall time, PluginError where it fails.
    """
    observer = loop_observer(bench, identity)
    assert isinstance(observer, Plugged)
    observer.declare_trims(declared_electrodes(bench, [0.0] * len(bench.trim.electrodes)))
    device = DeclaredLoop(
        Observer(board_device_of(bench), observer_settings_of(bench), controller_settings_of(bench, identity))
    )
    taken = np.zeros(_SAMPLES)
    for sample in range(_SAMPLES):
        sense, applied = device.sample()
        observer.enable_control(bench.controller.enabled and sample >= _QUIET)
        begun = time.perf_counter()
        codes = observer.tick(*map(float, sense), *map(float, applied))
        taken[sample] = time.perf_counter() - begun
        device.answer(codes)
    observer.close()
    slow = [part for part in observer.parts if part.in_python]
    if not slow:
        return []
    usual, late = (float(value) for value in np.percentile(taken[_QUIET:], [50.0, _LATE]))
    names = " and ".join(part.called for part in slow)
    rate = bench.device.sample_rate_Hz
    if bench.loop.clock != "lockstep" and usual * rate > 1.0:
        raise InputError(
            f"{names}: {quantity(usual, 's', 2)} a sample in Python, the board's are {quantity(1 / rate, 's')} apart; "
            'use [loop] clock = "lockstep", or compile it (hil init --plugin)'
        )
    return [
        f"{names}: in Python, {quantity(usual, 's', 2)} a sample ({quantity(late, 's', 2)} at the {_LATE:g} % mark), "
        f"which holds about {quantity(1.0 / late, 'Hz', 2)}; the board samples at {quantity(rate, 'Hz')}"
    ]


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
