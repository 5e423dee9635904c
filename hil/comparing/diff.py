"""Two runs, or two traces, side by side: figures with difference and uncertainty, and the bench keys that differ."""

import filecmp
import math
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from hil.errors import InputError
from hil.records.direct import DirectRecord
from hil.records.result import Result
from hil.records.runfolder import RunFolder


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
        """b − a."""
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


@dataclass(frozen=True)
class Key:
    """A key of the bench file that differs, as [section] key; None where a file does not have it."""

    name: str
    a: Any
    b: Any

    def as_json(self) -> dict[str, Any]:
        """In JSON values."""
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
        """As `hil diff --json` prints it."""
        figures = [
            {
                "name": one.name,
                "unit": one.unit,
                "a": one.a,
                "b": one.b,
                "uncertainty_a": one.u_a,
                "uncertainty_b": one.u_b,
                "difference": one.difference,
                "uncertainty": one.uncertainty,
                "apart": one.apart,
            }
            for one in self.figures
        ]
        return {
            "kind": self.kind,
            "a": str(self.a),
            "b": str(self.b),
            "verdict": [self.verdict_a or None, self.verdict_b or None],
            "same_record": self.same_record,
            "figures": figures,
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
    figures = _side_by_side(dict(_of_run(results[0])), dict(_of_run(results[1])), same)
    verdicts = [result.verdict or "" for result in results]
    keys = keys_apart(folders[0].bench, folders[1].bench)
    return Comparison("run", a, b, verdicts[0], verdicts[1], same, figures, keys)


def _traces(a: Path, b: Path) -> Comparison:
    from hil.records.diagnosis import load_diagnosis  # knows the estimator's words, which runs do without

    first, second = (load_diagnosis(place / "diagnosis.json") for place in (a, b))
    same = first.record == second.record
    figures = _side_by_side(dict(_of_trace(first)), dict(_of_trace(second)), same)
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


_Value = tuple[str, float | None, float | None]  # unit, value, half width


def _of_run(result: Result) -> Iterator[tuple[str, _Value]]:
    if result.angle is not None:
        yield "angle at the end", ("rad", result.angle.rad, result.angle_expanded_rad)
    yield "angle error, rms", ("rad", result.angle_error_rms_rad, None)
    if result.score is not None:
        yield "angle per rotation", ("", result.score.angle_per_rotation, None)
    yield "rate error, rms", ("rad/s", result.rate_error_rms_rad_s, None)
    yield "innovation, rms", ("V", result.innovation_rms, None)
    yield "noise floor", ("V", result.noise_floor, None)
    for name, parameter in result.parameters.items():
        yield name, (parameter.unit, parameter.value, parameter.half)
    if (answers := result.answers) is not None and answers.ticks:
        yield "answered in time", ("%", 100.0 * answers.in_time / answers.ticks, None)
    if (times := result.turnaround_us) is not None:
        for share, value in (("p50", times.p50), ("p99", times.p99), ("p99.9", times.p999)):
            yield f"turnaround {share}", ("µs", value, None)
    yield "length", ("s", result.seconds, None)


def _of_trace(found: Any) -> Iterator[tuple[str, _Value]]:
    for part, fit in (("before", found.held_out.before), ("after", found.held_out.after)):
        yield f"residual over floor, held out, {part}", ("", fit.ratio, None)
        yield f"residual, rms, held out, {part}", (found.sense_unit, fit.innovation_rms, None)
    yield "largest change of the angle", ("rad", found.angle_moved_rad, None)
    for effect in found.effects:
        yield f"{effect.name}: evidence", ("", effect.evidence, None)
        for symbol, one in effect.coefficients.items():
            yield f"{effect.name}: {symbol}", (one.unit, one.value, _half(*one.ci95))


def _half(low: float | None, high: float | None) -> float | None:
    return None if low is None or high is None else 0.5 * (high - low)


def _side_by_side(a: Mapping[str, _Value], b: Mapping[str, _Value], same: bool) -> tuple[Figure, ...]:
    """All figures that one of the two has, in the order of the first."""
    absent: _Value = ("", None, None)
    both = []
    for name in dict.fromkeys([*a, *b]):
        (unit, value_a, u_a), (other, value_b, u_b) = a.get(name, absent), b.get(name, absent)
        if (value_a, value_b) != (None, None):
            both.append(Figure(name, unit or other, value_a, value_b, u_a, u_b, same))
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
