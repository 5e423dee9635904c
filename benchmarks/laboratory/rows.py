"""Each kind of record through its map and a trace: is the coefficient inside its interval, the rest at the floor."""

import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from benchmarks.laboratory.kinds import KINDS, Kind, bench_text
from benchmarks.row import Row, Say
from hil.interchange.importer import import_record
from hil.records.diagnosis import Coefficient, Diagnosis
from hil.tracing import trace_file

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
    return made


def diagnosed(kind: Kind, work: Path) -> tuple[Diagnosis, float]:
    """The file written, imported and traced; the noise of a sample of the capture."""
    stem = kind.name.replace(" ", "-").replace(",", "")
    table, mapping, bench = (work / f"{stem}{end}" for end in (".csv", ".map.toml", ".bench.toml"))
    np.savetxt(
        table,
        np.column_stack(list(kind.columns.values())),
        delimiter=",",
        header=",".join(kind.columns),
        comments="",
        fmt="%.10g",
    )
    mapping.write_text(kind.map_text, encoding="utf-8")
    bench.write_text(bench_text(kind), encoding="utf-8")
    capture = work / f"{stem}.arrow"
    noise = float(kind.sense["noise_V"]) * import_record(table, capture, map_file=mapping).noise_gain
    done = trace_file(capture, bench, work / "runs", name=stem, fraction=None, report=False, progress=lambda _: None)
    return done.diagnosis, noise


def figures(name: str, diagnosis: Diagnosis, truth: Mapping[str, float], noise: float) -> list[Row]:
    """How far the coefficients are off, in half intervals (95 % are within 1), and the held-out error over noise."""
    found: dict[str, Coefficient] = {}
    for effect in diagnosis.effects:
        found |= effect.coefficients
    made = []
    for symbol, true in truth.items():
        off = float("inf")
        one = found.get(symbol)
        if one is not None and one.value is not None and None not in one.ci95:
            low, high = (float(end or 0.0) for end in one.ci95)
            off = abs(one.value - true) / (0.5 * (high - low))
        made.append(Row(f"{name}: {symbol} off, of half its interval", off, "1"))
    after = diagnosis.held_out.after.simulation_rmse or float("inf")
    made.append(Row(f"{name}: free run held out", after, diagnosis.sense_unit, "its noise", after / noise))
    return made
