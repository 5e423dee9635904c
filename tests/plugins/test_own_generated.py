"""The bench's own estimator as `hil generate` writes it, run as a plug-in: the same bits."""

from pathlib import Path

import numpy as np
import pytest

from hil.bench import Bench, override
from hil.records.runfolder import RunFolder
from tests.plugins.compiled import generated
from tests.plugins.running import bench, ran
from tests.running import gyro

pytestmark = pytest.mark.usefixtures("no_report", "no_scan", "no_sizes")


def with_plugins(declared: Bench, observer: str | None, controller: str | None) -> Bench:
    return override(declared, {"observer": {"plugin": observer}, "controller": {"plugin": controller}}, "test")


def differing(run: RunFolder, other: RunFolder) -> list[str]:
    """Columns of the record that are not the same to the last bit."""
    found = []
    for stem in ("capture", "estimates", "innovation"):
        ours, theirs = getattr(run, stem).columns, getattr(other, stem).columns
        assert ours.keys() == theirs.keys()
        found += [name for name in ours if not np.array_equal(ours[name], theirs[name], equal_nan=True)]
    return found


@pytest.mark.slow
@pytest.mark.parametrize("effects", [{}, {"drive_gain": {}}], ids=["base", "an effect"])
def test_it_leaves_the_bits_of_the_one_built_in(tmp_path: Path, effects: dict[str, dict[str, float]]) -> None:
    plain = override(bench(duration_s=1.5), {"effects": effects}, "test")
    own = generated(plain, tmp_path / "c", gyro.scenario(tmp_path / "board.toml"))
    built_in = ran(tmp_path / "built in", plain)
    plugged = ran(tmp_path / "plugged", with_plugins(plain, own, own))
    assert differing(plugged, built_in) == []
    assert plugged.result is not None
    assert plugged.result.remarks == built_in.result.remarks  # type: ignore[union-attr]


@pytest.mark.slow
def test_half_of_it_works_with_the_other_half_built_in(tmp_path: Path) -> None:
    plain = bench(duration_s=1.5)
    own = generated(plain, tmp_path / "c", gyro.scenario(tmp_path / "board.toml"))
    theirs = ran(tmp_path / "built in", plain).capture
    assert theirs is not None
    for place, halves in {"observer": (own, None), "controller": (None, own)}.items():
        ours = ran(tmp_path / place, with_plugins(plain, *halves)).capture
        assert ours is not None
        off = np.abs(ours.columns["ux_code"] - theirs.columns["ux_code"])
        assert off.max() <= 2, place  # a state that went through SI rounds otherwise, now and then a code
        assert np.mean(off == 0) > 0.9, place


def test_one_for_another_board_says_so(tmp_path: Path) -> None:
    import hil
    from hil.errors import InputError
    from tests.plugins.compiled import library

    hil.generate(bench(), out=tmp_path / "c", latency=3)
    own = library(tmp_path / "c" / "gyro_plugin.c")
    with pytest.raises(InputError, match="generated for another latency"):
        ran(tmp_path, bench(own, own))
