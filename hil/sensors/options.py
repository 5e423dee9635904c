"""What may be asked of a recording of a sensor beside its link: one declaration, from which every caller takes its
options: `hil record`, `hil.record`, the sensor of a test and the service's requests.
"""

from pathlib import Path
from typing import Annotated

from annotated_types import Gt, Le, MaxLen
from typing_extensions import TypedDict

from hil.options import Default, Help
from hil.records.kind import RunNameOption


class RecordOptions(TypedDict, total=False):
    """What may be asked of a recording from wherever."""

    duration_s: Annotated[
        Annotated[float, Gt(0.0), Le(1e6)] | None, Default(10.0), Help("Seconds of the sensor's time.")
    ]
    name: RunNameOption
    note: Annotated[Annotated[str, MaxLen(10_000)] | None, Help("A remark of the operator, kept in result.json.")]
    report: Annotated[bool, Default(True), Help("Draw report.html; leave it out to save time on many records.")]


class LocalRecordOptions(RecordOptions, total=False):
    """And what names a file of the machine on which it is done."""

    dbc: Annotated[Path | str | None, Help("A DBC that says what the sensor on a CAN bus sends.")]
