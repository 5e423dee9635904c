"""What is given and what is asked: the first part of a record, and windows of the rest of which the second half is
missing.
"""

import hashlib
import json
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evaluation.undeclared.population import Order, population
from evaluation.undeclared.record import make
from hil.bench import load_bench
from hil.methods.record import given

Floats = NDArray[np.float64]

SAMPLES = 60_000
SHARE = 0.6
"""Of a record that is given as it is; windows are cut from the rest."""
WINDOWS, SEEN, ASKED = 40, 200, 200
"""Of each record; samples of each that are given, and that are asked for."""
CATEGORIES = ("single", "double", "clean", "outside")


class Record(NamedTuple):
    """What an entrant has of one record: sense (n, 2) V and drive (n, 2) m/s², whose row m acted over the interval that
    ends at sample m; windows: sense (WINDOWS, SEEN, 2), drive (WINDOWS, SEEN + ASKED, 2).
    """

    name: str
    rate_Hz: float
    noise_V: Floats
    sense: Floats
    drive: Floats
    window_sense: Floats
    window_drive: Floats


def make_set(folder: Path, count: int, draw: int) -> list[str]:
    """Draw about `count` records and write them; returns their names."""
    orders = [order for order in population(2 * count, draw) if order.category in CATEGORIES][::2]
    public, sealed = folder / "open", folder / "sealed"
    for place in (public, sealed):
        place.mkdir(parents=True, exist_ok=True)
    names = []
    for number, order in enumerate(orders[:count]):
        name = f"record-{number:02d}"
        _keep(order, name, public, sealed)
        names.append(name)
    listed = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(sealed.iterdir())}
    (public / "sealed.sha256.json").write_text(json.dumps(listed, indent=1) + "\n")
    return names


def _keep(order: Order, name: str, public: Path, sealed: Path) -> None:
    with tempfile.TemporaryDirectory() as scratch:
        made = make(order, Path(scratch), SAMPLES)
        bench = load_bench(made / "bench.toml")
        record = given(made / "capture.arrow", bench)
        sense, drive = record.sense, record.samples.drive[:, :, 0]
        shutil.copy(made / "truth.json", sealed / f"{name}.truth.json")
        shutil.copy(made / "bench.toml", public / f"{name}.bench.toml")
    first = round(SHARE * len(sense))
    rng = np.random.default_rng(order.seed)
    starts = np.sort(rng.integers(first, len(sense) - SEEN - ASKED, WINDOWS))
    rows = starts[:, None] + np.arange(SEEN + ASKED)
    np.savez_compressed(
        public / f"{name}.npz", rate_Hz=bench.device.sample_rate_Hz, noise_V=np.array(record.device.noise),
        sense=sense[:first], drive=drive[:first], window_sense=sense[rows[:, :SEEN]], window_drive=drive[rows],
    )  # fmt: skip
    np.savez_compressed(sealed / f"{name}.npz", sense=sense[rows[:, SEEN:]])


def opened(folder: Path) -> list[Record]:
    """All records of an open set."""
    found = []
    for path in sorted(folder.glob("record-*.npz")):
        with np.load(path) as arrays:
            found.append(
                Record(
                    path.stem, float(arrays["rate_Hz"]), arrays["noise_V"], arrays["sense"], arrays["drive"],
                    arrays["window_sense"], arrays["window_drive"],
                )
            )  # fmt: skip
    if not found:
        raise SystemExit(f"challenge: {folder} has no record-*.npz; make one with: python -m benchmarks.challenge make")
    return found


def answer(folder: Path, name: str, sense: Floats) -> None:
    """Write the prediction (WINDOWS, ASKED, 2) for one record."""
    folder.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(folder / f"{name}.npz", sense=sense)


class Score(NamedTuple):
    """Of one record: error of the windows, rms, over the declared noise: of both channels, pooled."""

    name: str
    over_noise: float


def score(answers: Path, sealed: Path, public: Path) -> list[Score]:
    """Every record of the sealed set.  Ends with one line where an answer is missing or has another shape."""
    found = []
    for record in opened(public):
        with np.load(sealed / f"{record.name}.npz") as arrays:
            truth = arrays["sense"]
        path = answers / f"{record.name}.npz"
        if not path.exists():
            raise SystemExit(f"challenge: {path} is missing; answer every record of the set")
        with np.load(path) as arrays:
            said = arrays["sense"]
        if said.shape != truth.shape:
            raise SystemExit(f"challenge: {path} has shape {said.shape}; expected {truth.shape}")
        if not np.isfinite(said).all():
            raise SystemExit(f"challenge: {path} has a value that is not finite")
        apart = (said - truth) / record.noise_V
        found.append(Score(record.name, float(np.sqrt(np.nanmean(apart**2)))))
    return found


def overall(scores: Sequence[Score]) -> float:
    """Geometric mean over the records: what counts."""
    return float(np.exp(np.mean(np.log([one.over_noise for one in scores]))))
