"""A replay reads its record in pieces: the samples are those of the whole, gaps and their drive included."""

import numpy as np
import pytest

import hil.records.blocks
from hil.inputs.captured import pieces_of_samples, samples_of
from hil.records.capture import Capture
from hil.replaying.replay import _parts

EVERY, STRIDE = 5, 60


def record() -> Capture:
    rng = np.random.default_rng(1)
    tick = np.flatnonzero(rng.random(3000) > 0.2)
    codes = {name: rng.integers(-9, 9, tick.size).astype("i4") for name in ("vx_code", "ux_code")}
    about = {"vx_code": {"scale": 0.1, "unit": "V"}, "ux_code": {"scale": 0.2, "unit": "mps2"}}
    header = {"axes": 1, "tick_rate_Hz": 100.0, "latency_ticks": 1, "hold": "zoh", "columns": about}
    return Capture({"tick": tick, **codes, "flags": np.zeros(tick.size, "u1")}, header, complete=True)


def assert_same(pieces, whole) -> None:
    for column, values in zip(zip(*pieces, strict=True), whole, strict=True):
        np.testing.assert_array_equal(np.concatenate(column), values)


@pytest.mark.slow
@pytest.mark.parametrize("rows", [1, 7, 500, 10_000])
def test_the_pieces_make_the_whole(monkeypatch: pytest.MonkeyPatch, rows: int) -> None:
    whole = samples_of(record())
    monkeypatch.setattr(hil.records.blocks.pieces_of, "__defaults__", (rows,))
    assert_same(pieces_of_samples(record()), whole)
    parts = list(_parts(pieces_of_samples(record()), EVERY, STRIDE))
    assert_same(parts, whole)
    ends = np.cumsum([len(part[0]) for part in parts])
    assert set(range(STRIDE, len(whole[0]) + 1, STRIDE)) <= set(ends.tolist())
    assert not np.any(ends[:-1] % EVERY)
