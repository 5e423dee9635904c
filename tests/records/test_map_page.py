"""docs/reference/maps.md is what the maps are, and what it shows can be imported."""

import re
import tomllib
from pathlib import Path

import pytest

from hil.bench.device import Sense
from hil.importing.mapping import Columns, Filter, RecordMap, Source

PAGE = (Path(__file__).parents[2] / "docs" / "reference" / "maps.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("model", [RecordMap, Columns, Source, Filter])
def test_every_key_stands_on_it_with_its_meaning(model):
    for name, field in model.model_fields.items():
        assert f"`{name}`" in PAGE or f"[{name}]" in PAGE, name
        if model is not Columns:
            assert field.description or name in ("columns", "segments"), name
    assert "| None |" not in PAGE


def test_its_examples_are_maps_and_what_a_bench_file_says_beside_one():
    beam, flight, reed, declared = (tomllib.loads(text) for text in re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL))
    mapping = RecordMap.model_validate(beam)
    assert mapping.sense_unit == "px"
    assert RecordMap.model_validate(flight).columns.t_s.add[0].unit == "week"
    assert mapping.band(1000.0).rate_after_Hz == 250.0
    sense = Sense.model_validate(declared["device"]["sense"])
    assert sense.is_in_decibels
    assert RecordMap.model_validate(reed).sense_unit == sense.unit
