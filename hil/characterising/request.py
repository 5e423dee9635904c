"""A characterisation as it is asked for: for every caller alike."""

from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Real
from pathlib import Path

from hil.bench import Bench, RateSensorBench, load_any_bench
from hil.bench.examples import bench_file
from hil.characterising.options import LocalCharacteriseOptions
from hil.errors import InputError
from hil.errors.input import path_of, require
from hil.options import chosen
from hil.records.atomic import require_name
from hil.records.kind import fresh
from hil.records.runfolder import bench_of_record


@dataclass(frozen=True)
class CharacteriseRequest:
    """Records of one device, the truth of each or none, the bench file whose [limits] hold, see
    `LocalCharacteriseOptions`.
    """

    records: tuple[Path, ...]
    bench: Bench | RateSensorBench | None
    truth: tuple[Path, ...]
    name: str
    temperature_C: float | None = None
    report: bool = True
    calibrate: Path | None = None
    junit: Path | None = None


def request_of(
    records: Sequence[Path], bench: Bench | RateSensorBench | Path | str | None, options: LocalCharacteriseOptions
) -> CharacteriseRequest:
    """Put together what is asked.  bench: default that of the first run.  Raises InputError, in the words of
    `hil characterise`.
    """
    given = chosen(LocalCharacteriseOptions, options)
    files = given["truth"]
    files = (files,) if isinstance(files, str | Path) else tuple(files)
    truth = tuple(path_of("truth", file) for file in files)
    if not records:
        raise InputError("no record: name a run, a capture, or the link of a sensor")
    if truth and len(truth) != len(records):
        raise InputError(f"--truth: {len(truth)} for {len(records)} runs; give one for each, in their order")
    require("temperature_C", given["temperature_C"], Real | None, "a number of degrees Celsius")
    for record in records:
        if not record.exists():
            raise InputError(f"{record}: no such record; give a run folder, a capture, or the link of a sensor")
    if bench is None:
        bench = bench_of_record(records[0])
    declared = load_any_bench(bench_file("bench", bench)) if isinstance(bench, Path | str) else bench
    name = given["name"] or "data-sheet"
    require_name(name)
    junit = None if given["junit"] is None else fresh(path_of("junit", given["junit"]), replace=given["replace"])
    keep = None if given["calibrate"] is None else path_of("calibrate", given["calibrate"])
    return CharacteriseRequest(
        tuple(records), declared, truth, name, given["temperature_C"], given["report"], keep, junit
    )  # fmt: skip
