"""The emulator `cedar`: its integrator against SciPy, its record against the public reader and the published schema."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import jsonschema

import hil
from evaluation.strangers import cedar

CLEAN = 20


def test_an_interval_agrees_with_dop853() -> None:
    assert cedar.check() < 1e-9


def test_a_record_repeats_to_the_byte_and_is_read(tmp_path: Path) -> None:
    name = f"{CLEAN:02d}"
    assert cedar.main(["--seed", "1", "--out", str(tmp_path), "--only", str(CLEAN)]) == 0
    again = cedar.make(1, CLEAN)
    assert (tmp_path / f"{name}.csv").read_text() == cedar.csv_text(again)
    assert (tmp_path / f"{name}.bench.toml").read_text() == cedar.bench_text(again, name, 1)
    assert json.loads((tmp_path / "truth.json").read_text()) == {name: cedar.truth_of(again)}
    schema = json.loads((Path(__file__).parents[2] / "docs/reference/bench.schema.json").read_text())
    jsonschema.validate(tomllib.loads((tmp_path / f"{name}.bench.toml").read_text()), schema)
    imported = hil.import_record(tmp_path / f"{name}.csv", out=tmp_path / "record.arrow")
    assert imported.of_rows == len(again.v)
    assert 60_000 <= len(again.v) <= 130_000
