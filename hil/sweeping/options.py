"""What may be asked of a campaign beside its file: one declaration, from which every caller takes its options."""

from pathlib import Path
from typing import Annotated

from annotated_types import Ge, Le
from typing_extensions import TypedDict

from hil.options import Called, Help


class SweepOptions(TypedDict, total=False):
    """What may be asked of a campaign from wherever."""

    workers: Annotated[
        Annotated[int, Ge(1), Le(256)] | None,
        Help("Processes on this machine.  [default: one for each processor; for a request half as many]"),
    ]


class LocalSweepOptions(SweepOptions, total=False):
    """And what names a folder, or a machine in the network of the one on which it runs."""

    out: Annotated[
        Path | str | None,
        Called("out", "o"),
        Help("Folder of the results; if it has some already, the rest is added.  [default: runs/NAME]"),
    ]
    arm: Annotated[bool, Help("Consent to arming the board of a campaign with [table] or [chamber].")]
    baseline: Annotated[
        Path | str | None,
        Called("baseline"),
        Help("Earlier results, a folder or a Parquet file: fail where a figure got worse beyond its interval."),
    ]
    junit: Annotated[Path | str | None, Called("junit"), Help("Write what the baseline showed as JUnit XML too.")]
    replace: Annotated[bool, Help("Overwrite an existing file.")]
    scheduler: Annotated[str | None, Help("Make the runs on the Dask cluster of this scheduler, tcp://HOST:8786.")]
