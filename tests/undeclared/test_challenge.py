"""The challenge's task and score, on a set made by hand: nothing is recorded here."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.challenge import baselines, task
from benchmarks.challenge.task import ASKED, SEEN, WINDOWS


def oscillator(samples: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Two channels of a driven linear oscillator, and the drive."""
    rng = np.random.default_rng(seed)
    drive = rng.standard_normal((samples, 2))
    sense = np.zeros((samples, 2))
    for m in range(2, samples):
        sense[m] = 1.9 * sense[m - 1] - 0.98 * sense[m - 2] + 0.01 * drive[m]
    return sense, drive


@pytest.fixture
def made(tmp_path: Path) -> Path:
    """A set with one record of a device that is linear."""
    sense, drive = oscillator(6000)
    first = 3000
    starts = np.linspace(first, 6000 - SEEN - ASKED, WINDOWS).astype(int)
    rows = starts[:, None] + np.arange(SEEN + ASKED)
    for name in ("open", "sealed"):
        (tmp_path / name).mkdir()
    np.savez(
        tmp_path / "open" / "record-00.npz", rate_Hz=4000.0, noise_V=np.array([1e-3, 1e-3]), sense=sense[:first],
        drive=drive[:first], window_sense=sense[rows[:, :SEEN]], window_drive=drive[rows],
    )  # fmt: skip
    np.savez(tmp_path / "sealed" / "record-00.npz", sense=sense[rows[:, SEEN:]])
    return tmp_path


def test_the_truth_scores_nothing_and_a_noise_off_scores_one(made: Path) -> None:
    with np.load(made / "sealed" / "record-00.npz") as arrays:
        truth = arrays["sense"]
    task.answer(made / "right", "record-00", truth)
    task.answer(made / "off", "record-00", truth + 1e-3)
    scores = [task.score(made / name, made / "sealed", made / "open") for name in ("right", "off")]
    assert [found[0].over_noise for found in scores] == pytest.approx([0.0, 1.0])
    assert task.overall(scores[1]) == pytest.approx(1.0)


def test_a_linear_model_continues_a_linear_device(made: Path) -> None:
    (record,) = task.opened(made / "open")
    found = baselines.linear(record, 2)
    said = baselines.run_on(
        lambda past, u: baselines.regressors(past, u) @ found, 2, record.window_sense, record.window_drive, ASKED
    )
    task.answer(made / "linear", "record-00", said)
    assert task.score(made / "linear", made / "sealed", made / "open")[0].over_noise < 1e-6


@pytest.mark.parametrize(
    ("sense", "told"),
    [
        (None, "is missing"),
        (np.zeros((WINDOWS, ASKED, 1)), "expected (40, 200, 2)"),
        (np.full((WINDOWS, ASKED, 2), np.nan), "not finite"),
    ],
)
def test_an_answer_that_is_none_is_told_in_one_line(made: Path, sense: np.ndarray | None, told: str) -> None:
    if sense is not None:
        task.answer(made / "entry", "record-00", sense)
    with pytest.raises(SystemExit, match=r"challenge: .*record-00\.npz") as refused:
        task.score(made / "entry", made / "sealed", made / "open")
    assert told in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_folder_that_is_no_set_is_told(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match=r"no record-\*.npz"):
        task.opened(tmp_path)
