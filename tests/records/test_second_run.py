"""A board that was not reset goes on counting its samples: its second run is judged as its first."""

from pathlib import Path

import numpy as np
import pytest

from hil.records.runfolder import RunFolder
from hil.records.summary import summarise
from hil.scoring.score import score
from tests.records.synthetic_run import Options, write_run

FIRST_TICK = 987_654_321


def test_a_run_settles_after_its_first_sample(tmp_path: Path) -> None:
    results = {}
    for first_tick in (0, FIRST_TICK):
        place = tmp_path / str(first_tick)
        truth = write_run(place, Options(first_tick=first_tick))
        folder = RunFolder.open(place)
        assert folder.scored_from_s == pytest.approx(first_tick / 4000.0 + 0.5, abs=1e-6)
        assert folder.estimates is not None
        assert folder.innovation is not None
        assert len(folder.innovation.since(folder.scored_from_s)) == 6_000  # 1.5 of 2 s
        assert folder.estimates.settled(0.5).tick[0] == first_tick + 2_000
        results[first_tick] = summarise(folder), score(place, truth)
    for first, second in zip(*results.values(), strict=True):
        assert second.innovation_rms == pytest.approx(first.innovation_rms, rel=1e-9)
        assert second.noise_floor == pytest.approx(first.noise_floor, rel=1e-9)
    first, second = (scored for _, scored in results.values())
    assert second.angle_error_rms_rad == pytest.approx(first.angle_error_rms_rad, rel=1e-6)
    assert second.rate_error_rms_rad_s == pytest.approx(first.rate_error_rms_rad_s, rel=1e-6)
    assert np.isfinite(first.angle_error_rms_rad)
