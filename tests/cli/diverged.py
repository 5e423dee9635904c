"""A run whose observer diverged: from a third of it on its numbers grow beyond all bounds, then are none."""

from pathlib import Path

import numpy as np

from hil.records.runfolder import RunFolder
from hil.records.stream import BlockWriter
from tests.records.long_run import layout_of
from tests.records.synthetic_run import Options, write_run

KINDS = ("grows", "nan", "inf", "huge")


def write_diverged_run(folder: Path, kind: str) -> Path:
    """The folder's truth; estimates, innovation and covariance of the run are not finite in the end, or `huge`."""
    truth = write_run(folder, Options(seconds=2.0, result=False))
    run = RunFolder(folder)
    for stem in ("estimates", "innovation"):
        record = getattr(run, stem)
        layout = layout_of(record.header, stem)
        rows = np.zeros(len(record), layout.dtype)
        for name in layout.dtype.names or ():
            values = record.columns[name]
            if name not in ("tick", "valid"):
                values = diverged(values, kind)
            rows[name] = values
        (folder / f"{stem}.arrow").unlink()
        with BlockWriter(folder / f"{stem}.arrow", layout) as writer:
            writer.push(rows)
    return truth


def diverged(values: np.ndarray, kind: str) -> np.ndarray:
    """A series that is sound for its first third."""
    begin = values.size // 3
    sick = values.astype(float)
    if kind == "grows":
        with np.errstate(all="ignore"):
            sick[begin:] *= np.exp(np.linspace(0.0, 1500.0, values.size - begin))
        sick[-values.size // 6 :] = np.nan
    else:
        sick[begin:] = {"nan": np.nan, "inf": -np.inf, "huge": 1e200}[kind]
    with np.errstate(all="ignore"):
        return sick.astype(values.dtype)
