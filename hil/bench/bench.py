"""A whole bench file: its tables together, and how it is read."""

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

from pydantic import BaseModel, model_validator

from hil.bench.classic import name_plugin
from hil.bench.improbable import beside
from hil.bench.observer import BACKEND_BEFORE
from hil.bench.plausible import implausible
from hil.bench.rate_sensor import RateSensorBench
from hil.bench.section import Section, check_matrix
from hil.bench.tables import Tables
from hil.errors import InputError
from hil.toml.reading import parse_table, read_table


class Bench(Tables):
    """A whole bench file."""

    @model_validator(mode="before")
    @classmethod
    def _mode_has_its_plugin(cls, table: Any) -> Any:
        return name_plugin(table)

    @model_validator(mode="after")
    def _sections_agree(self) -> Self:
        axes, initial = self.device.axes, self.observer.initial
        if axes == 1 and self.controller.enabled:
            raise ValueError("[controller] enabled: a single axis has no pattern to control; set enabled = false")
        if axes == 1 and self.observer.variant == "gyro":
            raise ValueError('[observer] variant: "gyro" needs axes = 2; a single axis runs "full" or "sense"')
        if axes == 1 and self.observer.gain == "stationary":
            raise ValueError(
                '[observer] gain: "stationary" is a table over the pattern\'s angle, which needs axes = 2; use "fading"'
            )
        if self.observer.gain == "stationary" and self.observer.backend == "filterpy":
            raise ValueError('[observer] backend: "filterpy" has no stationary gain; use "c" or "numpy"')
        for key in ("stiffness_N_per_m", "damping_N_s_per_m"):
            if (given := getattr(initial, key)) is not None:
                check_matrix(f"[observer.initial] {key}", "k" if key.startswith("stiffness") else "d", given, axes)
        for key in ("position_m", "velocity_mps", "offset_V"):
            if (given := getattr(initial, key)) is not None and len(given) != axes:
                raise ValueError(f"[observer.initial] {key}: expected {axes} numbers, one per axis, not {len(given)}")
        if self.loop.mode == "board" and self.device.sense.interface.kind == "piezoresistive":
            raise ValueError(
                '[device.sense.interface] kind: "piezoresistive" needs the temperature, which a board\'s estimator '
                'is not given; set [loop] mode = "gain" or "force"'
            )
        if self.loop.in_blocks and axes != 2:
            raise ValueError(f'[loop] mode: "{self.loop.mode}" needs axes = 2, not {axes}; use "force"')
        if self.trim.electrodes and axes != 2:
            raise ValueError("[trim] electrodes: a single axis has no split to null; leave the table out")
        if self.trim.electrodes and self.loop.mode == "board":
            raise ValueError(
                '[trim] electrodes: a board\'s own estimator does not get their voltages; use [loop] mode = "gain"'
            )
        if self.trim.electrodes and self.controller.mode == "force_to_rebalance":
            raise ValueError(
                '[trim] electrodes: [controller] mode = "force_to_rebalance" holds the motion on one line, which shows '
                "one spring of two; use another mode, or leave the table out"
            )
        if self.trim.control and not self.controller.enabled:
            raise ValueError("[trim] control: nulls what a closed loop shows; set [controller] enabled = true")
        if self.link.watchdog_s is not None and self.link.watchdog_s < self.shortest_watchdog_s:
            what = "three blocks" if self.loop.in_blocks else "two samples"
            raise ValueError(f"[link] watchdog_s: shorter than {what} ({self.shortest_watchdog_s:g} s)")
        if self.target_stiffness_per_s2 == 0:
            raise ValueError(
                "[controller] target_stiffness_N_per_m: a mass on no spring needs one; its root over the mass is the "
                "scale of time"
            )
        if (finding := implausible(self)) is not None:
            raise ValueError(beside(finding, self))
        law = self.controller
        if law.enabled and law.amplitude_modulation and law.modulation_Hz > self.device.resonance_Hz / 10:
            told = f"must stay below a tenth of {self.device.resonance_Hz:.4g} Hz"
            if "modulation_Hz" in law.model_fields_set:
                finding = f"[controller] modulation_Hz: {told}"
            else:
                finding = f"[controller] amplitude_modulation: modulation_Hz is {law.modulation_Hz:g} Hz, and {told}"
            raise ValueError(beside(finding, self))
        return self

    def with_(self, **sections: Mapping[str, Any]) -> "Bench":
        """A bench with some keys replaced, by section: `bench.with_(loop={"duration_s": 5.0})`, checked as a whole
        again.  Tables within a section are merged key by key, everything else is replaced.

        Raises InputError with the key, and what was expected; also for an effect that there is not.
        """
        table = self.model_dump()
        if unknown := set(sections) - set(table):
            raise InputError(f"{unknown.pop()}: no section of a bench; there are {', '.join(table)}")
        return override(self, sections, f"{self.device.name or 'bench'} with changes")


def load_bench(path: Path) -> Bench:
    """The bench file at ``path``; `hil.errors.InputError` names file, key and what was expected."""
    bench = load_any_bench(path)
    if isinstance(bench, RateSensorBench):
        raise InputError(f"{path}: [device] axes: 0 is a rate-output sensor, which has no loop; trace its record")
    return bench


def load_any_bench(path: Path) -> Bench | RateSensorBench:
    """The bench file at ``path``, of an oscillator or (axes = 0) of a rate-output sensor; errors as of `load_bench`."""
    table = read_table(path)
    _tell_of_names_before(table, path)
    _find_files_beside(table, path)
    device = table.get("device")
    if isinstance(device, dict) and device.get("axes") == 0:
        return parse_table(table, RateSensorBench, str(path))
    return parse_table(table, Bench, str(path))


def _tell_of_names_before(table: Mapping[str, Any], path: Path) -> None:
    """One line for a value that is read under another name today."""
    observer = table.get("observer")
    if isinstance(observer, Mapping) and observer.get("backend") == BACKEND_BEFORE:
        line = f'{path}: [observer] backend: "{BACKEND_BEFORE}" is called "c" today, the default; take the key out'
        warnings.warn(line, FutureWarning, stacklevel=3)


def _find_files_beside(table: Mapping[str, Any], path: Path) -> None:
    """Files that lie beside the bench file, by their whole path: a run keeps the bench file in another folder."""
    device = table.get("device")
    calibration = device.get("calibration") if isinstance(device, dict) else None
    keys = ((table.get("observer"), "plugin"), (table.get("controller"), "plugin"), (calibration, "angle_map"))
    for section, key in keys:
        given = section.get(key) if isinstance(section, dict) else None
        if not isinstance(section, dict) or not isinstance(given, str) or not given:
            continue
        file, colon, attribute = given.rpartition(":") if ".py:" in given else (given, "", "")
        for place in (path.parent / file, Path(file)):
            if place.is_file():
                section[key] = f"{place.resolve()}{colon}{attribute}"
                break


def override(bench: Bench, changes: Mapping[str, Mapping[str, Any]], source: str) -> Bench:
    """``bench`` with some keys replaced, those of tables within its sections too, checked as a whole again; ``source``
    names them in an error.
    """
    table = bench.model_dump()
    make_way(table, changes)
    changed = _merged(table, changes)
    loop = changed["loop"]
    if isinstance(loop, dict) and loop["name"] != bench.loop.name:
        loop["bench"] = bench.loop.bench_name
    return parse_table(changed, Bench, source)


def make_way(table: dict[str, Any], changes: Mapping[str, Any], model: type[BaseModel] = Bench) -> bool:
    """Take out of `table` what `changes` give in another way, as stiffness_N_per_m where they have resonance_Hz;
    whether they have any key of that kind."""
    others = model.other_keys() if issubclass(model, Section) else {}
    found = False
    for key, value in changes.items():
        if key in others:
            table.pop(others[key], None)
            found = True
        field = model.model_fields.get(key)
        inner = None if field is None else field.annotation
        if isinstance(inner, type) and issubclass(inner, BaseModel) and isinstance(value, Mapping):
            found |= make_way(table.setdefault(key, {}), value, inner)
    return found


def _merged(table: Any, changes: Any) -> Any:
    """`table` with `changes` in it, table by table; what is no table on both sides is replaced."""
    if not isinstance(table, Mapping) or not isinstance(changes, Mapping):
        return changes
    return {**table, **{key: _merged(table.get(key), value) for key, value in changes.items()}}
