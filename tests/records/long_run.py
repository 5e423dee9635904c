"""A synthetic run made long by saying it again and again, its ticks going on; it is written piece by piece."""

import subprocess
import sys
from pathlib import Path

import numpy as np

from hil.records.estimates import covariance_layout, packed
from hil.records.layout import Layout
from hil.records.runfolder import RunFolder
from hil.records.stream import BlockWriter
from hil.records.truth import read_truth
from tests.records.synthetic_run import STATES, Options, write_run, write_truth_columns

RATE_HZ = 100_000.0
_ONCE_S = 5.0
_COVARIANCE_EVERY = 5000

PEAK = """
import sys
from pathlib import Path
from hil.cli import execute
code = execute(sys.argv[1:])
status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
print("\\npeak", status["VmHWM"].split()[0], code)
"""


def write_long_run(place: Path, seconds: float) -> tuple[Path, Path]:
    """Folder and truth of a run of so many seconds, a multiple of five, at 100 kS/s."""
    short = write_run(place / "short", Options(seconds=_ONCE_S, rate_Hz=RATE_HZ, result=False))
    folder, times, step = place / "long", round(seconds / _ONCE_S), round(_ONCE_S * RATE_HZ)
    folder.mkdir()
    (folder / "bench.toml").write_bytes((place / "short" / "bench.toml").read_bytes())
    read = RunFolder(place / "short")
    for stem in ("capture", "innovation", "estimates", "timing"):
        record = getattr(read, stem)
        layout = layout_of(record.header, stem)
        rows = np.zeros(len(record), layout.dtype)
        for name in layout.dtype.names or ():
            rows[name] = record.columns[name]
        with BlockWriter(folder / f"{stem}.arrow", layout) as writer:
            for _ in range(times):
                writer.push(rows)
                rows["tick"] += step
                for name in set(rows.dtype.names) & {"t_receive_ns", "t_send_ns"}:
                    rows[name] += round(_ONCE_S * 1e9)
    _write_covariance(folder, times * step)
    truth = place / "long-truth.arrow"
    once = read_truth(short)
    columns = {name: np.tile(once.columns[name], times) for name in once.columns}
    columns["tick"] = columns["tick"] + step * np.repeat(np.arange(times), len(once))
    write_truth_columns(truth, columns, once.header)
    return folder, truth


def layout_of(header: dict, kind: str) -> Layout:
    """The layout by which a record file with this header can be written again."""
    from hil.records.layout import Column

    types = {"tick": "i8", "flags": "u1", "valid": "u1", "t_receive_ns": "i8", "t_send_ns": "i8"}
    columns = []
    for name, about in header["columns"].items():
        code = types.get(name) or ("i4" if name.endswith("_code") else "f4" if kind == "innovation" else "f8")
        columns.append(Column(name, code, about["unit"], about["scale"], about.get("clock", "")))
    own = {key: value for key, value in header.items() if key not in ("kind", "version", "columns", "checksum")}
    return Layout(kind, tuple(columns), 16384, own)


def _write_covariance(folder: Path, ticks: int) -> None:
    names = list(STATES)
    layout = covariance_layout(names, ["1"] * len(names), tick_rate_Hz=RATE_HZ, every=_COVARIANCE_EVERY)
    values = packed(np.diag(np.geomspace(1e-12, 1e6, len(names))))
    with BlockWriter(folder / "covariance.arrow", layout) as writer:
        for tick in range(0, ticks, _COVARIANCE_EVERY):
            writer.put(tick, *values)


def peak_bytes(*arguments: str) -> int:
    """Largest resident memory of `hil` with these arguments, as a process.

    Of its own memory only: what getrusage says counts that of the process which started it.
    """
    child = subprocess.run([sys.executable, "-c", PEAK, *arguments], capture_output=True, text=True, check=False)
    last = [line for line in child.stdout.splitlines() if line.startswith("peak ")]
    assert last, child.stderr
    _, kilobytes, code = last[-1].split()
    assert code in ("0", "1"), child.stderr
    return 1024 * int(kilobytes)
