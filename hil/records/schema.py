"""The published JSON Schemas of result.json, diagnosis.json and comparison.json.

``python -m hil.records.schema FOLDER`` writes ``result.schema.json``, ``diagnosis.schema.json`` and
``comparison.schema.json``, which docs/reference keeps.
"""

import json
import sys
from pathlib import Path

from pydantic import BaseModel

from hil.records.diagnosis import Diagnosis
from hil.records.methods import Methods
from hil.records.result import Result


def schema_of(model: type[BaseModel]) -> str:
    """The schema as text, generated from the model that reads and writes the file."""
    schema = model.model_json_schema()
    return (
        json.dumps({"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}, indent=2, ensure_ascii=False)
        + "\n"
    )


def published() -> dict[str, str]:
    """Name and text of each schema file."""
    return {
        "result.schema.json": schema_of(Result),
        "diagnosis.schema.json": schema_of(Diagnosis),
        "comparison.schema.json": schema_of(Methods),
    }


if __name__ == "__main__":
    for name, text in published().items():
        (Path(sys.argv[1]) / name).write_text(text, encoding="utf-8")
