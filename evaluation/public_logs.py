"""Logs of commercial gyros that nobody here made: read as they are, and held against a second reading.

    python -m evaluation.public_logs FOLDER

FOLDER has a clone of each repository of `public_logs.toml`, called OWNER+NAME; what is read is the commit named there.
Each goes through `hil.record("replay:…")` or `hil.import_record`, unbent. The second reading shares nothing with the
bench: the golden text or the table that the log's authors put beside it, the bytes of its lines by `struct` after
canboat's description, the bits of its frames by asammdf and the maker's scale. Exit code 1 where one is wrong or
absent.
"""

import argparse
import re
import struct
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable
from math import radians
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

import hil
from hil.errors import InputError
from hil.records.capture import Capture, read_capture
from hil.records.rates import rates_rad_s
from hil.wire.errors import WireError

Floats = npt.NDArray[np.float64]
OFF_RAD_S = 1e-9
MANIFEST = Path(__file__).with_suffix(".toml")


class Absent(Exception):
    """There is no clone, or it lacks the commit."""


class Read(NamedTuple):
    """What a log says: rates (n, axes) rad/s, samples a second."""

    rates: Floats
    rate_Hz: float


def main() -> int:
    """Go through the manifest; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m evaluation.public_logs", description=__doc__)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    print("| log | sensor | samples, by the second reading | farthest off / (rad/s) | samples a second | |")
    print("|---|---|---|---|---|---|")
    wrong = 0
    for told in tomllib.loads(MANIFEST.read_text(encoding="utf-8"))["log"]:
        row, right = judged(told, folder)
        place = "/".join(Path(told["path"]).parts[-2:])
        print(f"| {told['repository']}, {place} | {told['sensor']} | {row} |", flush=True)
        wrong += not right
    return min(wrong, 1)


def judged(told: dict[str, Any], folder: Path) -> tuple[str, bool]:
    """The rest of a log's row, and whether it was read right."""
    with tempfile.TemporaryDirectory() as name:
        try:
            by_bench, by_other = read(told, folder, Path(name)), READERS[told["oracle"]["reader"]](told, folder)
        except Absent as absent:
            return f"| | | absent: {absent}", False
        except (InputError, WireError) as error:
            return f"| | | wrong: {str(error).replace(name, '')}", False
    same = by_bench.rates.shape == by_other.shape
    off = float(np.abs(by_bench.rates - by_other).max()) if same else np.inf
    low, high = told["rates_Hz"]
    right = off <= told.get("off_rad_s", OFF_RAD_S) and low <= by_bench.rate_Hz <= high
    counts = f"{len(by_bench.rates)} × {by_bench.rates.shape[1]}, {len(by_other)} × {by_other.shape[1]}"
    return f"{counts} | {off:.2g} | {by_bench.rate_Hz:.6g} | {'right' if right else 'wrong'}", right


def read(told: dict[str, Any], folder: Path, aside: Path) -> Read:
    """By the bench."""
    file = aside / Path(told["path"]).name
    file.write_bytes(blob(told, folder, told["path"]))
    if "dbc" not in told:
        link = f"replay:{file}{told.get('query', '')}"
        run = hil.record(link, duration_s=1e6, report=False, out=aside / "runs")
        return rates_of(read_capture(run.path / "capture.arrow"))
    dbc = told["dbc"]
    if "/" in dbc:
        (aside / "of.dbc").write_bytes(blob(told, folder, dbc))
        dbc = aside / "of.dbc"
    return rates_of(hil.import_record(file, dbc=dbc, out=aside / "log.arrow").capture)


def rates_of(capture: Capture) -> Read:
    return Read(np.column_stack(list(rates_rad_s(capture).values())), capture.tick_rate_Hz)


def blob(told: dict[str, Any], folder: Path, path: str) -> bytes:
    """A file of the commit."""
    clone = folder / told["repository"].replace("/", "+")
    places = [place for place in (clone, clone / "repo") if (place / "HEAD").exists() or (place / ".git").exists()]
    what = f"{told['commit']}:{path}"
    shown = subprocess.run(["git", "-C", places[0], "show", what], capture_output=True) if places else None
    if shown is None or shown.returncode:
        raise Absent(f"clone {told['repository']} of GitHub into {clone.name}, with commit {told['commit'][:9]}")
    return shown.stdout


def golden(told: dict[str, Any], folder: Path) -> Floats:
    """What the authors' own decoder printed."""
    text = blob(told, folder, told["oracle"]["path"]).decode()
    found = re.findall(r"RateOfTurn\(\w+\):\n\s+X:(\S+)\n\s+Y:(\S+)\n\s+Z:(\S+)", text)
    return np.array(found, float)


def table(told: dict[str, Any], folder: Path) -> Floats:
    """The authors' table, of which columns 7 to 9 are the rates; its first row says nothing."""
    lines = blob(told, folder, told["oracle"]["path"]).decode().splitlines()
    rows = [line.split(",")[6:9] for line in lines[1:] if line.count(",") > 9]
    return np.array(rows, float)


def lines(told: dict[str, Any], folder: Path) -> Floats:
    """Messages of one PGN by their bytes: 127251 has 2⁻⁵ µrad/s behind its first byte, 130842 m°/s behind 15 bytes."""
    pgn, found = told["oracle"]["pgn"], []
    for line in blob(told, folder, told["path"]).decode().splitlines():
        if len(parts := line.split(",")) > 6 and parts[2] == str(pgn):
            payload = bytes.fromhex("".join(parts[6:]))
        elif (parts := line.split())[1:2] == ["R"] and int(parts[2], 16) >> 8 & 0x1FFFF == pgn:
            payload = bytes.fromhex("".join(parts[3:]))
        else:
            continue
        if pgn == 127251:
            (turn,) = struct.unpack_from("<i", payload, 1)
            found.append([turn / 32e6])
        elif len(payload) >= 29 and payload[:2] == b"\x3f\x9f":
            found.append([radians(one / 1000.0) for one in struct.unpack_from("<3i", payload, 15)])
    return np.array(found)


def mf4(told: dict[str, Any], folder: Path) -> Floats:
    """Three values of 11 bits from bit 31, 42 and 53 on, 0.25 °/s each from -256 °/s on, as the maker says."""
    from asammdf import MDF

    with tempfile.TemporaryDirectory() as name:
        (Path(name) / "log.mf4").write_bytes(blob(told, folder, told["path"]))
        with MDF(Path(name) / "log.mf4") as log:  # one group or many, of each identifier its own
            places = log.channels_db["CAN_DataFrame"]
            groups = [log.get(group=group, index=index) for group, index in places]
    found = []
    for group in groups:
        wanted = group.samples["CAN_DataFrame.ID"].astype(np.int64) & 0x1FFFFFFF == told["oracle"]["identifier"]
        said = group.samples["CAN_DataFrame.DataBytes"][wanted]
        found += list(zip(group.timestamps[wanted].tolist(), map(bytes, said), strict=True))
    words = [int.from_bytes(row, "little") for _, row in sorted(found)]
    raw = np.array([[word >> bit & 0x7FF for bit in (31, 42, 53)] for word in words], float)
    return np.radians(0.25 * raw - 256.0)


READERS: dict[str, Callable[[dict[str, Any], Path], Floats]] = {
    "golden": golden, "table": table, "lines": lines, "mf4": mf4,
}  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
