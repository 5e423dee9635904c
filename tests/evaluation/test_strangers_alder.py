"""Records of evaluation.strangers.alder: the same from the same seed, integrated well, taken by the bench."""

import subprocess
import sys
from pathlib import Path

import pytest

import hil
from evaluation.strangers import alder
from evaluation.strangers.alder_check import check

SEED = 1
CLEAN = next(i for i, (kind, _) in enumerate(alder.plan(SEED), start=1) if kind == "clean")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("alder")
    alder.make(SEED, out, CLEAN)
    return out


@pytest.mark.slow
def test_one_seed_gives_the_same_bytes(folder: Path, tmp_path: Path) -> None:
    alder.make(SEED, tmp_path, CLEAN)
    names = sorted(path.name for path in folder.iterdir())
    assert names == [f"{CLEAN:02d}.bench.toml", f"{CLEAN:02d}.csv", "truth.json"]
    assert all((folder / name).read_bytes() == (tmp_path / name).read_bytes() for name in names)
    assert alder.plan(SEED + 1) != alder.plan(SEED)


@pytest.mark.slow
def test_the_integrator_agrees_with_dop853_and_the_matrix_exponential() -> None:
    assert check() == []


@pytest.mark.slow
def test_an_integrator_of_low_tolerance_fails_the_check(monkeypatch: pytest.MonkeyPatch) -> None:
    from evaluation.strangers import alder_check

    rough = alder_check.simulate
    monkeypatch.setattr(alder_check, "simulate", lambda *given, **named: rough(*given, **named, coarse=1e5))
    assert any("linear part" in fault for fault in check())


@pytest.mark.slow
def test_the_bench_takes_record_and_bench_file(folder: Path) -> None:
    bench = hil.load_bench(folder / f"{CLEAN:02d}.bench.toml")
    told = [sys.executable, "-m", "hil", "import", str(folder / f"{CLEAN:02d}.csv"), "-o", str(folder / "taken.arrow")]
    try:
        said = subprocess.run(told, capture_output=True, text=True, check=False)
    finally:
        (folder / "taken.arrow").unlink(missing_ok=True)
    assert said.returncode == 0, said.stderr
    assert bench.device.name == f"alder-{CLEAN:02d}"
    assert "two axes, zoh" in said.stdout + said.stderr


def test_a_seed_has_each_kind_as_often_as_told() -> None:
    kinds: dict[str, list[str]] = {}
    for kind, effects in alder.plan(SEED):
        kinds.setdefault(kind, []).append(" ".join(effect.key for effect in effects))
    counts = {"clean": 3, "clean single-tone": 2, "one": 14, "single-tone": 5, "two": 10, "outside": 6}
    assert {kind: len(names) for kind, names in kinds.items()} == counts
    assert all(len(set(kinds[kind])) == counts[kind] for kind in ("one", "single-tone", "two", "outside"))
