"""Files that the bench of November 2026 wrote (protocol 4) are read by the bench of today."""

import shutil
from pathlib import Path

import pytest

import hil
from hil.importing.importer import import_record
from hil.records.capture import read_capture
from hil.records.check import check
from hil.service.catalogue import queries
from hil.service.catalogue.catalogue import Catalogue

OLD = Path(__file__).parent / "protocol-4"
RUN, TRACE = OLD / "20261129-145644-old", OLD / "20261129-145547-und-trace"


def test_a_run_has_its_figures() -> None:
    """As the bench printed them then."""
    run = hil.load(RUN)
    assert run.verdict == "good"
    assert len(run.angle.values) == 60
    assert run.angle.values[-1] == pytest.approx(0.6142259746365225, abs=1e-12)
    assert run.result.angle_expanded_rad == pytest.approx(0.005726012945560573, rel=1e-9)
    assert run.bench.device.sample_rate_Hz == 4000.0


def test_a_run_is_whole_by_its_seals() -> None:
    found = check(RUN)
    assert len(found) >= 5
    assert [one.problems for one in found] == [[]] * len(found)


def test_a_run_is_replayed_to_the_same_angle(tmp_path: Path) -> None:
    before, today = hil.load(RUN), hil.replay(RUN, out=tmp_path)
    assert today.angle.values[-1] == pytest.approx(before.angle.values[-1], abs=1e-6)


def test_a_trace_names_its_effect() -> None:
    trace = hil.load_trace(TRACE)
    assert trace.verdict == "explained"
    (effect,) = trace.effects
    assert effect.name == "cubic_stiffness"
    assert effect.coefficients["k3x"].value == pytest.approx(1.0000465906702322e13, rel=1e-12)


def test_a_capture_has_what_it_was_imported_with() -> None:
    capture = read_capture(OLD / "imported.arrow")
    assert len(capture) == 400
    assert capture.segments == {"train": (0, 250), "test": (250, 400)}
    assert capture.header["covariates"] == {"temperature": 21.5}


def test_a_map_is_read(tmp_path: Path) -> None:
    rows = "".join(f"{k / 1000:.3f},{0.1 * (-1) ** k},0.0\n" for k in range(400))
    (tmp_path / "again.csv").write_text(f"time,response,excitation\n{rows}")
    import_record(
        tmp_path / "again.csv", tmp_path / "again.arrow", map_file=OLD / "bench_top.map.toml", nonuniform=False
    )
    assert read_capture(tmp_path / "again.arrow").segments["train"] == (0, 250)


def test_a_key_that_has_left_is_told_in_one_line() -> None:
    with pytest.warns(FutureWarning, match='backend: "numba" is called "c" today, the default; take the key out'):
        bench = hil.load_bench(OLD / "s-slow.bench.toml")
    assert bench.observer.backend == "c"


def test_a_catalogue_lists_what_it_listed(tmp_path: Path) -> None:
    folder, private = tmp_path / "runs", tmp_path / "private"
    shutil.copytree(OLD, folder)
    private.mkdir()
    shutil.copy(OLD / "catalogue.sqlite", private)
    catalogue = Catalogue(folder, private)
    try:
        assert {queries.one(catalogue, name)["id"] for name in (RUN.name, TRACE.name)} == {RUN.name, TRACE.name}
        catalogue.look()
        assert queries.one(catalogue, RUN.name)["verdict"] == "good"
    finally:
        catalogue.close()
