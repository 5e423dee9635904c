"""The observer that a bench file asks for: the bench's own, or one with plug-ins in it."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from estimator.observer import Observer
from estimator.settings import ControllerSettings, Device, ObserverSettings
from hil.bench import Bench, override
from hil.bench.classic import PLUGIN
from hil.errors import InputError
from hil.inputs.captured import control_of
from hil.inputs.declared import board_device_of, controller_settings_of, observer_settings_of, recorded_device_of
from hil.plugins.drive_table import DriveTable
from hil.plugins.finding import TABLE, Kind, called, found
from hil.plugins.parts import CARRIER, Compiled, InPython, PluginPart
from hil.plugins.plugged import Plugged, PluggedController, PluggedObserver
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
            part.options = loops | {"settle_s": bench.loop.settle_s}
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
