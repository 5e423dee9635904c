"""Each kind of record through its map and a trace: is the coefficient inside its interval, the rest at the floor."""

import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from benchmarks.laboratory.beam import Array
from benchmarks.laboratory.kinds import KINDS, Kind, bench_text
from benchmarks.laboratory.pools import POOLS, PoolKind
from benchmarks.row import Row, Say
from hil.importing.importer import import_record
from hil.records.diagnosis import Coefficient, Diagnosis
from hil.tracing.options import TraceOptions
from hil.tracing.request import request_of
from hil.tracing.trace import trace

SEED = 11


def rows(say: Say) -> list[Row]:
    """Two figures of each kind."""
    made = []
    with tempfile.TemporaryDirectory(prefix="gyrohil-") as work:
        for number, kind_of in enumerate(KINDS):
            kind = kind_of(np.random.default_rng((SEED, number)))
            diagnosis, noise = diagnosed(kind, Path(work))
            say(f"{kind.name}: {diagnosis.verdict}, {', '.join(effect.name for effect in diagnosis.effects)}")
            made += figures(kind.name, diagnosis, kind.truth, noise)
        for number, pool_of in enumerate(POOLS):
            pool = pool_of(np.random.default_rng((SEED, len(KINDS) + number)))
            diagnosis, noise = pooled(pool, Path(work))
            depend = ", ".join(f"{one.name} on {one.covariate}" for one in diagnosis.dependences)
            say(f"{pool.name}: {diagnosis.verdict}, {', '.join(effect.name for effect in diagnosis.effects)} {depend}")
            made += figures(pool.name, diagnosis, pool.truth, noise, pool.slopes)
    return made


def diagnosed(kind: Kind, work: Path) -> tuple[Diagnosis, float]:
    """The file written, imported and traced; the noise of a sample of the capture."""
    stem = kind.name.replace(" ", "-").replace(",", "")
    table, mapping, bench = (work / f"{stem}{end}" for end in (".csv", ".map.toml", ".bench.toml"))
    write_table(table, kind.columns)
    mapping.write_text(kind.map_text, encoding="utf-8")
    bench.write_text(bench_text(kind.rate_Hz, kind.sense), encoding="utf-8")
    capture = work / f"{stem}.arrow"
    noise = float(kind.sense["noise_V"]) * import_record(table, capture, map_file=mapping).noise_gain
    request = request_of(capture, bench, {"name": stem, "report": False})
    done = trace(request, work / "runs", progress=lambda _: None)
    return done.diagnosis, noise


def pooled(kind: PoolKind, work: Path) -> tuple[Diagnosis, float]:
    """The files written, imported and traced together; the noise of a sample."""
    folder = work / kind.name.replace(" ", "-").replace(",", "")
    folder.mkdir()
    bench, captures = folder / "beam.bench.toml", []
    bench.write_text(bench_text(kind.rate_Hz, kind.sense), encoding="utf-8")
    for name, (columns, map_text) in kind.files.items():
        write_table(folder / f"{name}.csv", columns)
        mapping = folder / f"{name}.map.toml"
        mapping.write_text(map_text, encoding="utf-8")
        captures.append(folder / f"{name}.arrow")
        import_record(folder / f"{name}.csv", captures[-1], map_file=mapping)
    options: TraceOptions = {
        "name": folder.name, "covariate": kind.covariate, "hold_out": kind.held_out, "report": False,
    }  # fmt: skip
    done = trace(request_of(captures, bench, options), work / "runs", progress=lambda _: None)
    return done.diagnosis, float(kind.sense["noise_V"])


def write_table(path: Path, columns: Mapping[str, Array]) -> None:
    """A CSV file with a header."""
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="", fmt="%.10g")


def figures(
    name: str,
    diagnosis: Diagnosis,
    truth: Mapping[str, float],
    noise: float,
    slopes: Mapping[str, float] | None = None,
) -> list[Row]:
    """How far the coefficients are off, in half intervals (95 % are within 1), and the held-out error over noise."""
    found: dict[str, Coefficient] = {}
    for effect in diagnosis.effects:
        found |= effect.coefficients
    slopes = slopes or {}
    for one in diagnosis.dependences:
        found[f"slope of {one.name}"] = one.per_unit
        if one.name not in slopes:
            slopes = {**slopes, one.name: 0.0}  # there is none
    made = []
    for symbol, true in ({**truth} | {f"slope of {symbol}": true for symbol, true in slopes.items()}).items():
        off = float("inf")
        seen = found.get(symbol)
        if seen is not None and seen.value is not None and None not in seen.ci95:
            low, high = (float(end or 0.0) for end in seen.ci95)
            off = abs(seen.value - true) / (0.5 * (high - low))
        made.append(Row(f"{name}: {symbol} off, of half its interval", off, "1"))
    after = diagnosis.held_out.after.simulation_rmse or float("inf")
    made.append(Row(f"{name}: free run held out", after, diagnosis.sense_unit, "its noise", after / noise))
    return made
