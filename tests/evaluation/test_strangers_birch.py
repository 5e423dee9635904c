"""Records of evaluation.strangers.birch: same bytes from the same seed, an exact motion, a form that hil reads."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from pyarrow import csv

import hil
from evaluation.strangers import birch, birch_check, birch_laws


@pytest.fixture(scope="module")
def clean() -> int:
    """Number of a record without an effect, which takes no search for a size."""
    return 1 + [kind for kind, _ in birch.plan(5)].index("clean")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, clean: int) -> Path:
    out = tmp_path_factory.mktemp("birch")
    assert birch.main(["--seed", "5", "--out", str(out), "--only", str(clean)]) == 0
    return out


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bytes(folder: Path, clean: int, tmp_path: Path) -> None:
    birch.main(["--seed", "5", "--out", str(tmp_path), "--only", str(clean)])
    names = sorted(path.name for path in folder.iterdir())
    assert names == sorted([f"{clean:02d}.bench.toml", f"{clean:02d}.csv", "truth.json"])
    for name in names:
        assert (folder / name).read_bytes() == (tmp_path / name).read_bytes(), name


@pytest.mark.slow
def test_the_motion_is_that_of_scipy_and_closed_forms() -> None:
    worst = birch_check.check()
    assert len(worst) == len(birch_laws.CATALOGUE) + len(birch_laws.OUTSIDE) + 2
    assert max(worst.values()) < 1e-9


@pytest.mark.slow
def test_hil_reads_record_and_bench_file(folder: Path, clean: int, tmp_path: Path) -> None:
    assert hil.load_bench(folder / f"{clean:02d}.bench.toml").device.axes == 2
    written = csv.read_csv(folder / f"{clean:02d}.csv")
    assert 60_000 <= len(written) <= 130_000
    begin, capture = tmp_path / "begin.csv", tmp_path / "begin.arrow"
    csv.write_csv(written.slice(0, 4000), begin)
    subprocess.run([sys.executable, "-m", "hil", "import", str(begin), "-o", str(capture)], check=True)
    again = csv.read_csv(hil.export(capture, tmp_path / "again.csv"))
    for name in ("vx_V", "vy_V", "ux_mps2", "uy_mps2"):
        np.testing.assert_allclose(again[name].to_numpy(), written[name].to_numpy()[:4000], rtol=1e-12)


def test_forty_records_of_the_kinds_that_are_wanted() -> None:
    kinds = [kind for kind, _ in birch.plan(5)]
    counts = {kind: kinds.count(kind) for kind in kinds}
    assert counts == {"clean": 3, "clean single-tone": 2, "one": 14, "single-tone": 5, "two": 10, "outside": 6}
    firsts = [names[0] for kind, names in birch.plan(5) if kind == "one"]
    assert len(set(firsts)) == 14
