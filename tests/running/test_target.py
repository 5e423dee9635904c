"""Steps of the target stiffness: the drive takes up the difference, and the angle does not notice."""

from pathlib import Path

import numpy as np
import pytest

from hil.bench import load_bench, override
from hil.bench.examples import find
from hil.records.capture import read_capture
from hil.running.request import RunRequest
from hil.running.run import run
from hil.scoring.score import score

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("no_report", "no_scan")]  # a whole run

STEP, RATE, HALF = 0.02, 4000, 1000


@pytest.mark.long
def test_the_drive_follows_the_steps_and_the_angle_does_not(tmp_path: Path) -> None:
    changes = {
        "loop": {"clock": "lockstep", "duration_s": 6.0, "settle_s": 3.0},
        "controller": {"stiffness_step": STEP, "stiffness_step_Hz": RATE / HALF / 2},
    }
    bench = override(load_bench(find("bench", "s-slow")), changes, "test")
    truth = tmp_path / "truth.arrow"
    done = run(
        RunRequest(bench, f"inproc:{find('scenario', 's-slow')}", {"truth": truth}), tmp_path, progress=lambda _: None
    )
    assert done.folder is not None
    capture = read_capture(done.folder / "capture.arrow")
    gain = bench.device.sense_gains_V_per_m[0]
    settled = capture.tick >= 3 * RATE
    up = (capture.tick // HALF) % 2 == 0
    slopes = []
    for side in (up, ~up):
        # The drive held at m was computed a sample before, and half a sample of hold ahead.
        rows = np.flatnonzero(settled & side & (capture.tick % HALF > 20))
        x = capture.sense_V[rows - 1] / gain
        motion = np.column_stack([np.ones(len(rows)), x])
        slopes.append(np.linalg.lstsq(motion, capture.drive[rows, 0], rcond=None)[0][1])
    assert slopes[1] - slopes[0] == pytest.approx(2 * STEP * bench.target_stiffness_per_s2, rel=0.1)
    assert (score(done.folder, truth).angle_error_rms_rad or 1.0) < 3e-3
