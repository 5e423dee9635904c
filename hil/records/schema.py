"""The published JSON Schema of result.json.

``python -m hil.records.schema FOLDER`` writes ``result.schema.json``, which docs/reference keeps.
"""

import json
import sys
from pathlib import Path

from hil.records.result import Result


def result_schema() -> str:
    """The schema as text, generated from the model that reads and writes result.json."""
    schema = Result.model_json_schema()
    return json.dumps({"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}, indent=2) + "\n"


if __name__ == "__main__":
    (Path(sys.argv[1]) / "result.schema.json").write_text(result_schema(), encoding="utf-8")
