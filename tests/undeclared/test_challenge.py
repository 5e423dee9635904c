"""The challenge's task and score, on a set made by hand, and whole sets of a record or two."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.challenge import baselines, draw, task, tracer
from benchmarks.challenge.task import ASKED, SEEN, WINDOWS
from hil.bench import load_bench


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
        tmp_path / "open" / "record-00.npz", rate_Hz=4000.0, noise_V=np.array([1e-3, 1e-3]), sense_V=1.0,
        drive_mps2=1.0, sense=sense[:first], drive=drive[:first], window_sense=sense[rows[:, :SEEN]],
        window_drive=drive[rows],
    )  # fmt: skip
    sealed = tmp_path / "sealed" / "record-00.npz"
    np.savez(sealed, sense=sense[rows[:, SEEN:]])
    hashes = {sealed.name: hashlib.sha256(sealed.read_bytes()).hexdigest()}
    (tmp_path / "open" / task.HASHES).write_text(json.dumps(hashes))
    return tmp_path


@pytest.mark.moderate
def test_the_truth_scores_nothing_and_a_noise_off_scores_one(made: Path) -> None:
    with np.load(made / "sealed" / "record-00.npz") as arrays:
        truth = arrays["sense"]
    task.answer(made / "right", "record-00", truth)
    task.answer(made / "off", "record-00", truth + 1e-3)
    scores = [task.score(made / name, made / "sealed", made / "open") for name in ("right", "off")]
    assert [found[0].over_noise for found in scores] == pytest.approx([0.0, 1.0])
    assert task.overall(scores[1]) == pytest.approx(1.0)


@pytest.mark.moderate
def test_a_linear_model_continues_a_linear_device(made: Path) -> None:
    (record,) = task.opened(made / "open")
    found = baselines.linear(record, 2)
    said = baselines.run_on(
        lambda past, u: baselines.regressors(past, u) @ found, 2, record.window_sense, record.window_drive, ASKED
    )
    task.answer(made / "linear", "record-00", said)
    assert task.score(made / "linear", made / "sealed", made / "open")[0].over_noise < 1e-6


@pytest.mark.moderate
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


@pytest.mark.moderate
def test_what_was_sealed_cannot_be_changed_afterwards(made: Path) -> None:
    sealed = made / "sealed" / "record-00.npz"
    with np.load(sealed) as arrays:
        task.answer(made / "entry", "record-00", arrays["sense"])
    np.savez(sealed, sense=np.zeros((WINDOWS, ASKED, 2)))
    with pytest.raises(SystemExit, match="not what was sealed"):
        task.score(made / "entry", made / "sealed", made / "open")
    sealed.unlink()
    with pytest.raises(SystemExit, match="the set's keeper has it"):
        task.score(made / "entry", made / "sealed", made / "open")


def test_a_secret_gives_its_records_and_no_other_gives_them(tmp_path: Path) -> None:
    draw.make_secret(tmp_path / "secret")
    secret = draw.read_secret(tmp_path / "secret")
    assert draw.orders(12, secret) == draw.orders(12, secret)
    one, other = draw.orders(12, secret), draw.orders(12, secret + b"0")
    assert {order.seed for order in one}.isdisjoint(order.seed for order in other)
    assert max(order.seed for order in one) > 2**48  # more than can be tried
    assert [order.effects for order in one] != [order.effects for order in other]
    assert {c: sum(order.category == c for order in one) for c in draw.SHARES} == draw.SHARES
    with pytest.raises(SystemExit, match="there already"):
        draw.make_secret(tmp_path / "secret")
    (tmp_path / "short").write_text("11\n")
    with pytest.raises(SystemExit, match="can be tried out"):
        draw.read_secret(tmp_path / "short")
    with pytest.raises(SystemExit, match="no such file"):
        draw.read_secret(tmp_path / "none")


@pytest.mark.long
@pytest.mark.timeout(600)
def test_a_set_says_what_the_board_did_and_nothing_of_what_is_sealed(tmp_path: Path) -> None:
    """A record of a device with a cubic stiffness: the bench's own entry continues it, the linear model less well."""
    order = draw.Sealed("single", ("cubic_stiffness",), 0, 0, b"x" * 32)
    assert task.make_set(tmp_path, [order], 24_000) == ["record-00"]
    with pytest.raises(SystemExit, match="has a set already"):
        task.make_set(tmp_path, [order], 24_000)
    truth = json.loads((tmp_path / "sealed" / "record-00.truth.json").read_text())
    assert truth["effects"][0]["name"] == "cubic_stiffness"
    told = b"".join(path.read_bytes() for path in (tmp_path / "open").iterdir())
    assert b"cubic" not in told
    assert str(order.seed).encode() not in told
    (record,) = task.opened(tmp_path / "open")
    assert record.sense.shape == record.drive.shape == (14_400, 2)
    bench = load_bench(tmp_path / "open" / "record-00.bench.toml")
    found, carried = tracer.found_in(record, bench)
    assert found == ("explained", ("cubic_stiffness",))
    task.answer(tmp_path / "tracer", "record-00", tracer.continued(record, carried))
    task.answer(tmp_path / "untraced", "record-00", tracer.continued(record, bench))
    ours, plain = (
        task.overall(task.score(tmp_path / name, tmp_path / "sealed", tmp_path / "open"))
        for name in ("tracer", "untraced")
    )
    assert ours < 3.0
    assert ours < 0.5 * plain


@pytest.mark.moderate
@pytest.mark.filterwarnings("ignore:.*is called .c. today:FutureWarning")  # published before it was
def test_the_published_set_is_whole_and_keeps_its_secret() -> None:
    """Twelve records with their bench files, and a hash for everything that is sealed; nothing of it among them."""
    published = sorted(Path(task.__file__).parent.glob("sets/*/open"))
    assert published
    for public in published:
        records = task.opened(public)
        names = [record.name for record in records]
        hashes = json.loads((public / task.HASHES).read_text())
        assert set(hashes) == {f"{name}{end}" for name in names for end in (".npz", ".truth.json")}
        for record in records:
            assert load_bench(public / f"{record.name}.bench.toml").device.sample_rate_Hz == record.rate_Hz
            assert record.sense.shape == record.drive.shape
            assert record.window_sense.shape == (WINDOWS, SEEN, 2)
            assert record.window_drive.shape == (WINDOWS, SEEN + ASKED, 2)
        assert not (public.parent / "sealed").exists()
