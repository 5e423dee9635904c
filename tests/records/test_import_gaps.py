"""A gap in a record from elsewhere is a gap: counted, its drive unknown, passed over."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from hil.errors import InputError
from hil.importing.importer import import_record
from hil.importing.uniformity import numbered
from hil.inputs.captured import drives_of, samples_of
from hil.records.capture import Capture, RowFlag
from hil.records.check import check
from tests.estimator.driven_axis import DEVICE

STEP = 1e-3
N = 4000
MAP = """\
hold = "bandlimited"
[columns]
t_s = { column = "t", unit = "s" }
vx_V = { column = "x", unit = "V" }
"""


def kept_without(*gaps: tuple[int, int]) -> np.ndarray:
    kept = np.ones(N, bool)
    for begin, end in gaps:
        kept[begin:end] = False
    return np.flatnonzero(kept)


TEN = kept_without(*((300 * k + 100, 300 * k + 130) for k in range(10)))
ONE = kept_without((2000, 2020))


@pytest.fixture
def bring(tmp_path: Path) -> Callable[..., Capture]:
    def bring(t_s: np.ndarray, **options: object) -> Capture:
        source = tmp_path / "ride.csv"
        drive = np.random.default_rng(1).standard_normal(len(t_s))
        rows = (f"{t:.6f},{np.sin(t):.6f},{u:.6f}" for t, u in zip(t_s, drive, strict=True))
        source.write_text("t_s,vx_V,ux_mps2\n" + "\n".join(rows) + "\n")
        return import_record(source, tmp_path / "ride.arrow", nonuniform=True, **options)  # type: ignore[arg-type]

    return bring


@pytest.mark.parametrize(("kept", "lost", "gaps"), [(ONE, 20, 1), (TEN, 300, 10)], ids=["one", "ten of 30 ms"])
def test_missing_samples_are_counted(
    bring: Callable[..., Capture], tmp_path: Path, kept: np.ndarray, lost: int, gaps: int
) -> None:
    capture = bring(STEP * kept)
    assert (capture.uniform, capture.tick_rate_Hz) == (True, 1000.0)
    assert (capture.lost, capture.gaps) == (lost, gaps)
    np.testing.assert_array_equal(capture.tick, kept)
    assert int(np.sum(capture.flags & RowFlag.GAP_BEFORE != 0)) == gaps
    (found,) = check(tmp_path / "ride.arrow")
    assert (found.lost, found.gaps) == (lost, gaps)
    assert found.remarks == [f"{lost} samples are missing, in {gaps} gap{'s' if gaps > 1 else ''}"]


@pytest.mark.parametrize("hold", ["zoh", "foh", "bandlimited"])
def test_the_drive_over_a_gap_is_not_known(bring: Callable[..., Capture], hold: str) -> None:
    capture = bring(STEP * ONE, hold=hold)
    drives = drives_of(capture, DEVICE)
    assert drives is not None
    samples = samples_of(capture, drives)
    assert np.all(np.isnan(samples.sense[2000:2020]))
    spread = drives.spread(samples.gap[[2019]])
    assert np.all(np.diagonal(spread[0]) > 0.0)
    if hold != "zoh":
        assert np.all(np.isinf(spread))


def test_a_band_limited_drive_ends_at_a_gap(bring: Callable[..., Capture]) -> None:
    """What stands in the gap changes no derivative beside it."""
    capture = bring(STEP * ONE, hold="bandlimited")
    samples = samples_of(capture, drives_of(capture, DEVICE))
    alone = samples_of(capture.part(0, 2000))
    np.testing.assert_allclose(samples.drive[:2000], alone.drive)


@pytest.mark.parametrize("jitter", [0.05, 0.2])
def test_uneven_time_with_a_gap(bring: Callable[..., Capture], jitter: float) -> None:
    uneven = STEP * (ONE + jitter * np.random.default_rng(2).uniform(-1, 1, len(ONE)))
    capture = bring(uneven)
    assert not capture.uniform
    assert (capture.lost, capture.gaps) == (20, 1)
    samples = samples_of(capture, drives_of(capture, DEVICE))
    assert len(samples.tick) == N
    np.testing.assert_allclose(np.cumsum(samples.step[1:])[ONE[1:] - 1], capture.t_s[1:] - capture.t_s[0])
    assert np.max(samples.step) < 2.0 * STEP


@pytest.mark.parametrize(
    "steps",
    [
        np.random.default_rng(3).uniform(0.2, 3.0, N),  # sampled as it came
        np.random.default_rng(4).exponential(1.0, N) + 0.01,
        np.diff(np.round(np.arange(N) / 0.7)),  # 700 Hz, stamped in ms
        np.diff(np.floor(np.arange(N) / 0.999)),  # 999 Hz
        np.diff(np.round(np.arange(N) / 0.4)),  # 400 Hz
        np.where(np.arange(N) % 1000 < 500, 1.0, 2.0),  # one rate, then another
    ],
    ids=["uniform draws", "exponential", "700 Hz in ms", "999 Hz in ms", "400 Hz in ms", "two rates"],
)
def test_uneven_time_lacks_nothing(steps: np.ndarray) -> None:
    assert numbered(STEP * np.concatenate([[0.0], np.cumsum(steps)])).lost == 0


@pytest.mark.parametrize("seed", range(20))
def test_random_losses_are_losses(seed: int) -> None:
    """Of one in twenty samples, at a rate that six digits do not give."""
    kept = np.flatnonzero(np.random.default_rng(seed).uniform(size=N) > 0.05)
    found = numbered(np.round(kept / 4001.2345678, 7))
    np.testing.assert_array_equal(found.tick, kept - kept[0])
    assert found.uniform


def test_a_gap_is_named_where_time_is_to_be_even(tmp_path: Path) -> None:
    source = tmp_path / "ride.csv"
    source.write_text("t_s,vx_V\n" + "\n".join(f"{STEP * k:.3f},1" for k in ONE))
    with pytest.raises(InputError) as refused:
        import_record(source, tmp_path / "x.arrow")
    assert str(refused.value).endswith(
        ":2002: column t_s: step of 0.021 s where 0.001 s is usual; 20 samples are missing, in 1 gap; "
        "give --nonuniform to keep them as gaps"
    )


def test_more_missing_than_there_is_refused(tmp_path: Path) -> None:
    source = tmp_path / "ride.csv"
    source.write_text("t_s,vx_V\n" + "\n".join(f"{STEP * k + 1e3 * (k > 50):.3f},1" for k in range(100)))
    with pytest.raises(InputError, match="1000000 samples are missing, in 1 gap, more than there are"):
        import_record(source, tmp_path / "x.arrow", nonuniform=True)


def test_no_filter_runs_over_a_gap(tmp_path: Path) -> None:
    source, made = tmp_path / "ride.csv", tmp_path / "ride.map.toml"
    source.write_text("t,x\n" + "\n".join(f"{STEP * k:.3f},1" for k in ONE))
    made.write_text(MAP + "[filter]\nlow_Hz = 5.0\nhigh_Hz = 50.0\n")
    with pytest.raises(InputError, match=r"\[filter\] needs samples without a gap, but 20 samples are missing"):
        import_record(source, tmp_path / "x.arrow", map_file=made, nonuniform=True)
