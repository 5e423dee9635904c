"""What the closing scan leaves of the calibration's constants holds what the emulated device was given."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from benchmarks.uncertainty import PLANTS, bench_of, scenario_text
from estimator.completeness.answer import Outcome
from hil.bench import override
from hil.records.runfolder import RunFolder
from hil.running.closing_scan import scan_run
from hil.running.request import RunRequest
from hil.running.run import run

DRAWN = 7145003
"""An S-modern whose drive gain is off by 1.14 × 10⁻³: an observer's own equations left (0.54 ± 0.04) × 10⁻³ of it."""


@pytest.mark.slow
def test_constants_are_right_from_rest_at_200_kilosamples(tmp_path: Path) -> None:
    plant = PLANTS["S-modern calibrated"]
    bench = bench_of(plant, DRAWN)
    scenario = tmp_path / "drawn.scenario.toml"
    scenario.write_text(scenario_text(plant, DRAWN, bench), encoding="utf-8")
    done = run(RunRequest(bench, f"inproc:{scenario}"), tmp_path, progress=lambda _: None)
    assert done.folder is not None
    scanned = scan_run(RunFolder.open(done.folder), bench, lambda _: None)
    assert scanned is not None
    assert scanned.information is not None
    found = scanned.information.posterior(bench.device.calibration.by_symbol(bench.device.resonance_rad_s))
    effects = tomllib.loads(scenario.read_text(encoding="utf-8"))["effect"]
    drawn = {symbol: value for effect in effects for symbol, value in effect.items()}
    off = np.array([value - drawn[symbol] for symbol, value in zip(found.symbols, found.mean, strict=True)])
    assert np.all(np.abs(off) < 4.0 * found.deviation), dict(zip(found.symbols, off / found.deviation, strict=True))
    at = found.symbols.index("hx")
    assert found.deviation[at] < 0.1 * drawn["hx"]  # which the record does tell
    angle = float(abs(found.sensitivity[-1] @ off))
    assert angle < 4.0 * found.angle_deviation[-1]


FAR_OFF = 7154005
"""An S-modern whose constants, as the bench file has them, leave 3.4 times the noise; turned twice as far as there."""


@pytest.mark.slow
def test_constants_that_were_found_leave_no_more_than_the_noise(tmp_path: Path) -> None:
    """A filter that follows a wrong model by a random force goes on doing so beside the constants that mend it, unless
    it is asked to try without."""
    plant = PLANTS["S-modern"]
    turned = {"controller": {"virtual_rotation_rad_s": 12.0, "virtual_reversal_s": 0.26}}
    bench = override(bench_of(plant, FAR_OFF), turned, "S-modern")
    scenario = tmp_path / "drawn.scenario.toml"
    scenario.write_text(scenario_text(plant, FAR_OFF, bench), encoding="utf-8")
    done = run(RunRequest(bench, f"inproc:{scenario}"), tmp_path, progress=lambda _: None)
    assert done.folder is not None
    scanned = scan_run(RunFolder.open(done.folder), bench, lambda _: None)
    assert scanned is not None
    assert scanned.outcome is Outcome.COMPLETE, scanned.reason
    assert scanned.information is not None
    assert scanned.ratio == pytest.approx(1.0, abs=0.02)
