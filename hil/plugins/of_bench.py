"""The observer that a bench file asks for: the bench's own, or one with plug-ins in it.

Plug-ins tried before a board is armed: on the declared device, in its loop, with what they say checked as in a run.

What they do wrong at once is found here, and how many samples a second one in Python holds.
"""

import ctypes
import json
import resource
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from signal import Signals
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from estimator.declared_loop import DeclaredLoop
from estimator.observer import Observer
from estimator.settings import ControllerSettings, Device, ObserverSettings
from hil.bench import Bench, override
from hil.bench.classic import PLUGIN
from hil.errors import InputError
from hil.inputs.captured import control_of, declared_electrodes
from hil.inputs.declared import board_device_of, controller_settings_of, observer_settings_of, recorded_device_of
from hil.numbers import quantity
from hil.plugins import native
from hil.plugins.finding import TABLE, Kind, called, found
from hil.plugins.native import Death, Part, PluginState, Watch
from hil.plugins.parts import CARRIER, Compiled, InPython, PluginPart
from hil.plugins.plugged import Plugged, PluggedController, PluggedObserver
from hil.plugins.protocol import DeclaredDevice
from hil.records.capture import Capture
from hil.wire.messages import Identity

_FINEST = 1e-9
"""A code of a record that has none, V and m/s²: beyond what any converter shows."""


def plugins_of(bench: Bench) -> dict[Kind, str]:
    """The plug-ins that a bench names, by place; of a controller that is not enabled, none."""
    named: dict[Kind, str | None] = {
        "observer": bench.observer.plugin,
        "controller": bench.controller.plugin if bench.controller.enabled else None,
    }
    return {kind: name for kind, name in named.items() if name is not None}


def part_of(kinds: Sequence[Kind], name: str) -> PluginPart:
    """The plug-in of a name, in the places where it is named.  Raises InputError, one line."""
    behind = found(kinds[0], name)
    for kind in kinds[1:]:  # the same class has to have both methods
        found(kind, name)
    if not isinstance(behind, Path):
        return InPython(kinds, name, behind)
    return (DriveTable if behind.suffix == TABLE else Compiled)(kinds, name, behind)


def parts_of(bench: Bench, named: dict[Kind, str]) -> list[PluginPart]:
    """Each plug-in, made ready, with its options; one that is named twice is one."""
    places: dict[str, list[Kind]] = {}
    for kind, name in named.items():
        places.setdefault(name, []).append(kind)
    parts = [part_of(kinds, name) for name, kinds in places.items()]
    for part in parts:
        if part.name == PLUGIN:
            loops = bench.controller.loops.options(bench.controller.mode)
            part.options = loops | {"settle_s": bench.loop.settle_s, "damping_sd_per_s": bench.damping_sd_per_s}
    return parts


def require_supported(bench: Bench) -> None:
    """InputError for what no plug-in can be used with."""
    named = plugins_of(bench)
    for kind, name in named.items():
        if bench.loop.mode != "force":
            raise InputError(
                f'{called(kind, name)}: in [loop] mode = "{bench.loop.mode}" the board computes the drive, by what the '
                'bench\'s own control law gives it; use mode = "force"'
            )
        if bench.device.axes != 2:
            raise InputError(f"{called(kind, name)}: [device] axes = {bench.device.axes}; a plug-in has two")
    if "controller" in named and bench.controller.stiffness_step:
        raise InputError(
            f"{called('controller', named['controller'])}: [controller] stiffness_step moves the target of the bench's "
            "own control law; take it out"
        )
    effects = [*bench.effects.named, *bench.effects.custom]
    if "observer" in named and "controller" not in named and bench.controller.enabled and effects:
        raise InputError(
            f"{called('observer', named['observer'])}: the bench's own control law cannot undo [effects.{effects[0]}] "
            "by another's observer; take [effects] out, or give a [controller] plugin too"
        )


def observer_of(
    bench: Bench, device: Device, settings: ObserverSettings, controller: ControllerSettings
) -> Observer | Plugged:
    """The observer of `bench` for a board, or a record of one.  Raises InputError for a plug-in that cannot be used."""
    named = plugins_of(bench)
    if not named:
        return Observer(device, settings, controller)
    require_supported(bench)
    kind = PluggedObserver if "observer" in named else PluggedController
    return kind(device, settings, controller, parts_of(bench, named))


def recorded_observer(bench: Bench, record: Capture) -> Observer:
    """The observer plug-in of `bench`, for a record. Raises InputError as `observer_of`, and for a record of another
    kind.
    """
    name = bench.observer.plugin
    assert name is not None
    if record.axes != 2 or bench.device.axes != 2:
        raise InputError(f"{called('observer', name)}: this record has {record.axes} axes; a plug-in has two")
    columns = record.header["columns"]
    scales = [float(columns.get(f"{stem}x_code", {}).get("scale", 0.0)) for stem in "vu"]
    driven = override(bench, {"controller": {"enabled": True}}, called("observer", name))
    known = control_of(driven, record)
    assert known is not None
    control = replace(known, sense_quantum=scales[0] or _FINEST, force_quantum=scales[1] or _FINEST)
    (part,) = parts_of(bench, {"observer": name})
    if record.carrier_Hz is not None:
        part.options = {**part.options, CARRIER: record.carrier_Hz}
    shown = recorded_device_of(bench, record)
    device = replace(shown, sample_rate=bench.device.sample_rate_Hz)  # whose cycles an observer of samples can follow
    streams = None if record.carrier_Hz is None else shown
    return PluggedObserver(device, observer_settings_of(bench), control, [part], streams)


def loop_observer(bench: Bench, identity: Identity) -> Observer:
    """That of a run, whose plug-ins answer in time.  Raises InputError, and PluginError of what fails as it begins."""
    observer = observer_of(
        bench, board_device_of(bench), observer_settings_of(bench), controller_settings_of(bench, identity)
    )
    if isinstance(observer, Plugged):
        observer.allow(bench.link.timeout_s if bench.loop.clock == "lockstep" else bench.watchdog_s)
        observer.begin_running()
    return observer


_SHAPES = {"forces": 2, "pieces": 1, "limit_V": 1}


class DriveTable(PluginPart):
    """A table of drives, `FILE.npz`: an experiment that is planned before the board is armed, played by C, a row a
    sample from the one on with which the loop is closed.  As observer it estimates nothing.

    Arrays of the file: `forces` (rows, 2) m/s²; `pieces` (rows,), numbers of parts of it, in order; `limit_V` (2,),
    sense voltages beyond which the piece at work is not driven to its end.
    """

    size = ctypes.sizeof(native.Table)

    def __init__(self, kinds: Sequence[Kind], name: str, path: Path) -> None:
        super().__init__(kinds, name)
        try:
            with np.load(path, allow_pickle=False) as file:
                given = {key: np.array(file[key], dtype=float) for key in _SHAPES}
        except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
            told = f"no array {error}" if isinstance(error, KeyError) else "no table of drives"
            raise InputError(f"{self.called}: {path}: {told}; expected forces, pieces and limit_V in an .npz") from None
        forces, pieces, limit = (given[key] for key in _SHAPES)
        if forces.ndim != 2 or forces.shape[1] != 2 or pieces.shape != forces.shape[:1] or limit.shape != (2,):
            raise InputError(f"{self.called}: {path}: expected forces (n, 2), pieces (n,) and limit_V (2,)")
        if not np.isfinite(forces).all() or not (limit > 0.0).all() or not np.isfinite(pieces).all():
            raise InputError(f"{self.called}: {path}: every force has to be finite, and limit_V above 0")
        self._forces: NDArray[np.float64] = np.ascontiguousarray(forces)
        self._pieces = np.ascontiguousarray(pieces, np.int32)
        self._limit = limit

    def address(self, kind: Kind) -> int:
        call = "drive_table_observe" if kind == "observer" else "drive_table_control"
        return ctypes.cast(getattr(native.library(), call), ctypes.c_void_p).value or 0

    def begin(self, state: PluginState, at: int, device: DeclaredDevice, names: Sequence[str]) -> None:
        if np.abs(self._forces).max(initial=0.0) > device.drive_limit_mps2 * (1.0 + 1e-9):
            most = np.abs(self._forces).max()
            raise InputError(f"{self.called}: it asks for {most:g} m/s², the limit is {device.drive_limit_mps2:g} m/s²")
        table = native.Table(self._forces.ctypes.data, self._pieces.ctypes.data, len(self._forces))
        table.limit_V[:] = self._limit.tolist()
        table.ended = -1
        ctypes.memmove(state.lent[at].at, ctypes.byref(table), ctypes.sizeof(table))


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
