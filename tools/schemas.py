"""The published JSON Schemas (draft 2020-12) of the files that are read and written."""

import json
import re

from pydantic import BaseModel

from hil.bench.bench import Bench
from hil.bench.rate_sensor import RateSensorBench
from hil.records.data_sheet import DataSheet
from hil.records.diagnosis import Diagnosis
from hil.records.methods import Methods
from hil.records.result import Result
from hil.sweeping.campaign import Campaign

PUBLISHED: dict[str, type[BaseModel]] = {
    "bench": Bench,
    "campaign": Campaign,
    "characteristics": DataSheet,
    "comparison": Methods,
    "diagnosis": Diagnosis,
    "rate-sensor": RateSensorBench,
    "result": Result,
}


def schema_of(model: type[BaseModel]) -> str:
    """The schema as text; a limit is 1 or 1.0 as equal annotations were imported, and is written as 1."""
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", **model.model_json_schema()}
    text = json.dumps(schema, indent=2, ensure_ascii=False) + "\n"
    return re.sub(r'(imum": -?[0-9]+)\.0\b', r"\1", text)
