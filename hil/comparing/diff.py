"""Two runs, or two traces, side by side: figures with difference and uncertainty, and the bench keys that differ."""

import filecmp
import math
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from hil.errors import InputError
from hil.records.direct import DirectRecord
from hil.records.figures import Known, of_run, of_trace
from hil.records.result import Result
from hil.records.runfolder import RunFolder

if TYPE_CHECKING:
    from hil.records.diagnosis import Diagnosis


@dataclass(frozen=True)
class Figure:
    """One figure of both. None: one of the two does not have it, or nothing is known of how far it may be off.

    >>> kxx = Figure("kxx", "1/s²", 10.0, 16.0, u_a=3.0, u_b=4.0)
    >>> kxx.difference, kxx.uncertainty, kxx.apart
    (6.0, 5.0, True)
    """

    name: str
    unit: str
    a: float | None
    b: float | None
    u_a: float | None = None
    """Half width of the 95 % interval of `a`, or its expanded uncertainty (k = 2)."""
    u_b: float | None = None
    same_record: bool = False

    @property
    def difference(self) -> float | None:
        return None if self.a is None or self.b is None else self.b - self.a

    @property
    def uncertainty(self) -> float | None:
        """Of the difference (95 %). Of two records: the root of the sum of squares (JCGM 100, 5.1.2). Of one record,
        where both figures share their noise in a way that nobody knows: the sum, which is the most it can be.
        """
        if self.u_a is None or self.u_b is None:
            return None
        return self.u_a + self.u_b if self.same_record else math.hypot(self.u_a, self.u_b)

    @property
    def apart(self) -> bool | None:
        """Whether the difference is larger than its uncertainty; None where there is none."""
        if self.difference is None or self.uncertainty is None:
            return None
        return abs(self.difference) > self.uncertainty

    def as_json(self, u_a: str, u_b: str) -> dict[str, Any]:
        """In JSON values, by these names for the uncertainties of `a` and `b`."""
        told = {name: getattr(self, name) for name in ("name", "unit", "a", "b")} | {u_a: self.u_a, u_b: self.u_b}
        return told | {name: getattr(self, name) for name in ("difference", "uncertainty", "apart")}


@dataclass(frozen=True)
class Key:
    """A key of the bench file that differs, as [section] key; None where a file does not have it."""

    name: str
    a: Any
    b: Any

    def as_json(self) -> dict[str, Any]:
        return {"key": self.name, "a": _plain(self.a), "b": _plain(self.b)}


@dataclass(frozen=True)
class Comparison:
    """Two folders of one kind. In figures and keys, a is of the first, b of the second."""

    kind: Literal["run", "trace"]
    a: Path
    b: Path
    verdict_a: str
    verdict_b: str
    same_record: bool
    figures: tuple[Figure, ...]
    bench: tuple[Key, ...]

    def as_json(self) -> dict[str, Any]:
        return {
            "kind": self.kind,
            "a": str(self.a),
            "b": str(self.b),
            "verdict": [self.verdict_a or None, self.verdict_b or None],
            "same_record": self.same_record,
            "figures": [one.as_json("uncertainty_a", "uncertainty_b") for one in self.figures],
            "bench": [key.as_json() for key in self.bench],
        }


def compare(a: Path, b: Path) -> Comparison:
    """The runs, or the traces, in two folders.  Raises InputError where they are not of one kind, or one has no figures
    yet.
    """
    traces = [(place / "diagnosis.json").exists() for place in (a, b)]
    if traces[0] != traces[1]:
        trace, run = (a, b) if traces[0] else (b, a)
        raise InputError(f"{trace}: a trace, but {run} is a run; compare two runs, or two traces")
    return _traces(a, b) if traces[0] else _runs(a, b)


def _runs(a: Path, b: Path) -> Comparison:
    folders = RunFolder.open(a), RunFolder.open(b)
    results = [_result(folder) for folder in folders]
    same = same_record(folders[0].capture_path, folders[1].capture_path)
    figures = _side_by_side(_of_run(results[0]), _of_run(results[1]), same)
    verdicts = [result.verdict or "" for result in results]
    keys = keys_apart(folders[0].bench, folders[1].bench)
    return Comparison("run", a, b, verdicts[0], verdicts[1], same, figures, keys)


def _traces(a: Path, b: Path) -> Comparison:
    from hil.records.diagnosis import load_diagnosis  # knows the estimator's words, which runs do without

    first, second = (load_diagnosis(place / "diagnosis.json") for place in (a, b))
    same = first.record == second.record
    figures = _side_by_side(_of_trace(first), _of_trace(second), same)
    benches = [RunFolder(place).bench for place in (a, b)]
    return Comparison("trace", a, b, first.verdict, second.verdict, same, figures, keys_apart(*benches))


def _result(folder: RunFolder) -> Result:
    if (found := folder.result) is None:
        raise InputError(f"{folder.path}: no result.json; `hil replay {folder.path}` computes its figures")
    return found


def same_record(a: Path, b: Path) -> bool:
    """Whether two captures hold the same: by their last checksum, which depends on all of it, where they have one."""
    if not (a.exists() and b.exists()) or a.stat().st_size != b.stat().st_size:
        return False
    with suppress(InputError), DirectRecord(a) as one, DirectRecord(b) as other:
        if one.seal is not None and other.seal is not None:
            return one.seal == other.seal
    return filecmp.cmp(a, b, shallow=False)


_ABOVE = {
    "angle_rad": "angle at the end", "angle_error_rms_rad": "angle error, rms",
    "angle_per_rotation": "angle per rotation", "rate_error_rms_rad_s": "rate error, rms",
    "innovation_rms": "innovation, rms", "noise_floor": "noise floor",
}  # fmt: skip
_BELOW = {
    "answered_fraction": "answered in time", "turnaround_p50_us": "turnaround p50",
    "turnaround_p99_us": "turnaround p99", "turnaround_p999_us": "turnaround p99.9", "seconds": "length",
}  # fmt: skip
"""What figures of a run are called beside those of its parameters, in this order."""
_HELD_OUT = {"ratio": "residual over floor, held out", "innovation_rms": "residual, rms, held out"}


def _of_run(result: Result) -> dict[str, Known]:
    found = _called(of_run(result), _ABOVE | {name: name for name in result.parameters} | _BELOW)
    if (share := found.get("answered in time")) is not None:
        found["answered in time"] = share._replace(value=100.0 * share.value, unit="%")
    return found


def _of_trace(found: "Diagnosis") -> dict[str, Known]:
    names = {f"{name}_{part}": f"{words}, {part}" for part in ("before", "after") for name, words in _HELD_OUT.items()}
    names["angle_moved_rad"] = "largest change of the angle"
    for effect in found.effects:
        names |= {f"{effect.name}.{one}": f"{effect.name}: {one}" for one in ("evidence", *effect.coefficients)}
    return _called(of_trace(found), names)


def _called(figures: Iterable[Known], names: Mapping[str, str]) -> dict[str, Known]:
    """Those that have one of these names, in their order, by what they are called here."""
    known = {one.name: one for one in figures}
    return {called: known[name] for name, called in names.items() if name in known}


def _side_by_side(a: Mapping[str, Known], b: Mapping[str, Known], same: bool) -> tuple[Figure, ...]:
    """All figures that one of the two has, in the order of the first."""
    both = []
    for name in dict.fromkeys([*a, *b]):
        one, other = a.get(name), b.get(name)
        unit = (one and one.unit) or (other and other.unit) or ""
        values = (one and one.value, other and other.value, one and one.u, other and other.u)
        both.append(Figure(name, unit, *values, same))
    return tuple(both)


def keys_apart(a: Mapping[str, Any], b: Mapping[str, Any]) -> tuple[Key, ...]:
    """The keys in which two bench files differ, given as plain tables."""
    flat_a, flat_b = dict(_flat(a)), dict(_flat(b))
    names = dict.fromkeys([*flat_a, *flat_b])
    return tuple(Key(n, flat_a.get(n), flat_b.get(n)) for n in names if flat_a.get(n) != flat_b.get(n))


def _flat(table: Mapping[str, Any], sections: tuple[str, ...] = ()) -> Iterator[tuple[str, Any]]:
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from _flat(value, (*sections, key))
        else:
            yield (f"[{'.'.join(sections)}] {key}" if sections else key), value


def _plain(value: Any) -> Any:
    """As JSON has it: what it has not, a date or an infinity, in words."""
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    known = value is None or isinstance(value, str | int) or (isinstance(value, float) and math.isfinite(value))
    return value if known else str(value)
