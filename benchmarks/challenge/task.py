"""What is given and what is asked: the first part of a record, and windows of the rest of which the second half is
missing.
"""

import hashlib
import json
import math
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from evaluation.undeclared.population import Order
from evaluation.undeclared.record import make
from hil.bench import load_bench
from hil.comparing.course import given
from hil.records.atomic import write_text

Floats = NDArray[np.float64]

SAMPLES = 40_000
SHARE = 0.6
"""Of a record that is given as it is; windows are cut from the rest."""
WINDOWS, SEEN, ASKED = 40, 200, 200
"""Of each record; samples of each that are given, and that are asked for."""
HASHES = "sealed.sha256.json"


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


def make_set(folder: Path, orders: Sequence[Order], samples: int = SAMPLES) -> list[str]:
    """Record them and write the set: `open` for entrants, `sealed` for its keeper; returns the records' names.  Ends
    with one line where a set is there already.
    """
    public, sealed = folder / "open", folder / "sealed"
    if public.exists() or sealed.exists():
        raise SystemExit(f"challenge: {folder} has a set already; give another folder")
    for place in (public, sealed):
        place.mkdir(parents=True)
    names = [f"record-{number:02d}" for number in range(len(orders))]
    for name, order in zip(names, orders, strict=True):
        _keep(order, name, public, sealed, samples)
    listed = {path.name: _digest(path) for path in sorted(sealed.iterdir())}
    write_text(public / HASHES, json.dumps(listed, indent=1) + "\n")
    return names


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _keep(order: Order, name: str, public: Path, sealed: Path, samples: int) -> None:
    with tempfile.TemporaryDirectory() as scratch:
        made = make(order, Path(scratch), samples)
        bench = load_bench(made / "bench.toml")
        record = given(made / "capture.arrow", bench)
        truth = json.loads((made / "truth.json").read_text())
        shutil.copy(made / "truth.json", sealed / f"{name}.truth.json")
        shutil.copy(made / "bench.toml", public / f"{name}.bench.toml")
    quantum = _quanta(truth["scenario"])
    sense, drive = _codes(record.sense, quantum[0]), _codes(record.samples.drive[:, :, 0], quantum[1])
    first = round(SHARE * len(sense))
    rng = np.random.default_rng(order.seed)
    starts = np.sort(rng.integers(first, len(sense) - SEEN - ASKED, WINDOWS))
    rows = starts[:, None] + np.arange(SEEN + ASKED)
    np.savez_compressed(
        public / f"{name}.npz", rate_Hz=bench.device.sample_rate_Hz, noise_V=np.array(record.device.noise),
        sense_V=quantum[0], drive_mps2=quantum[1], sense=sense[:first], drive=drive[:first],
        window_sense=sense[rows[:, :SEEN]], window_drive=drive[rows],
    )  # fmt: skip
    np.savez_compressed(sealed / f"{name}.npz", sense=quantum[0] * sense[rows[:, SEEN:]])


def _quanta(scenario: dict[str, Any]) -> tuple[float, float]:
    """What a sense code is worth in V, a drive code in m/s²."""
    sense, drive = scenario["sense"], scenario["drive"]
    return (
        2.0 * sense["adc_full_scale_V"] / 2 ** sense["adc_bits"],
        math.ldexp(drive["full_scale_mps2"], 1 - drive["dac_bits"]),
    )


def _codes(values: Floats, quantum: float) -> NDArray[np.int16]:
    """The converter's own numbers: an eighth of the bytes."""
    codes = np.rint(values / quantum)
    if not np.allclose(codes * quantum, values, rtol=1e-9, atol=1e-6 * quantum) or np.abs(codes).max() > 2**15:
        raise AssertionError("a record that is not of converters of 16 bits at most, or has a gap")
    return np.clip(codes, -(2**15), 2**15 - 1).astype(np.int16)


def opened(folder: Path) -> list[Record]:
    """All records of an open set.  Ends with one line where there are none."""
    found = []
    for path in sorted(folder.glob("record-*.npz")):
        with np.load(path) as arrays:
            volts, force = float(arrays["sense_V"]), float(arrays["drive_mps2"])
            found.append(
                Record(
                    path.stem, float(arrays["rate_Hz"]), arrays["noise_V"], volts * arrays["sense"],
                    force * arrays["drive"], volts * arrays["window_sense"], force * arrays["window_drive"],
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
    """Every record of the sealed set.  Ends with one line where an answer is missing or has another shape, or what is
    sealed is not what was sealed.
    """
    _require_sealed(sealed, public)
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


def _require_sealed(sealed: Path, public: Path) -> None:
    """Every file that the open set has a hash of is there, and is that one."""
    for name, digest in json.loads((public / HASHES).read_text()).items():
        path = sealed / name
        if not path.exists():
            raise SystemExit(f"challenge: {path} is missing; the set's keeper has it, and scores")
        if _digest(path) != digest:
            raise SystemExit(f"challenge: {path} is not what was sealed: its hash differs from {public / HASHES}")


def overall(scores: Sequence[Score]) -> float:
    """Geometric mean over the records: what counts."""
    return float(np.exp(np.mean(np.log([one.over_noise for one in scores]))))
