"""What other verbs do with a bench file whose [controller] mode has loops of its own."""

from pathlib import Path

import numpy as np
import pytest

import hil
from hil.bench import override
from hil.errors import InputError
from hil.progress import untold
from hil.records.runfolder import RunFolder
from hil.replaying.replay import replay
from tests.plugins.running import bench, ran

FORCED = {"controller": {"mode": "force_to_rebalance", "dither_mps2": 0.0}, "loop": {"duration_s": 3.0}}


@pytest.mark.slow
@pytest.mark.usefixtures("no_report")
def test_its_record_is_read_by_the_observer_of_the_bench(tmp_path: Path) -> None:
    declared = override(bench(), FORCED, "test")
    run = ran(tmp_path, declared)
    assert run.estimates is not None
    assert run.estimates.header["plugins"] == {"observer": "classic", "controller": "classic"}
    again = replay(run.capture_path, declared, tmp_path / "again", progress=untold)
    assert again.folder is not None
    read = RunFolder(again.folder).estimates
    assert read is not None
    assert "plugins" not in read.header
    assert np.mean(read["energy_ratio"][-100:]) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("kind", ["observer", "controller"])
def test_a_plug_in_is_not_written_as_the_estimator_of_a_board(tmp_path: Path, kind: str) -> None:
    declared = override(bench(), {kind: {"plugin": "mine.so"}}, "test")
    with pytest.raises(InputError, match=rf"\[{kind}\] plugin mine.so: cannot be generated"):
        hil.generate(declared, out=tmp_path / "out", sense_scale=1e-5, drive_scale=1e-3)
    assert not (tmp_path / "out").exists()


def test_it_is_not_written_as_the_estimator_of_a_board(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r'mode = "force_to_rebalance": the source\'s estimator is written'):
        hil.generate(override(bench(), FORCED, "test"), out=tmp_path / "out", sense_scale=1e-5, drive_scale=1e-3)
