"""What counts as right is right: an observer that carries the effect finds the coefficients that are expected.

Emulator and estimator define each effect on their own; this is where signs, units and conventions meet.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from estimator.effects.catalogue import names
from estimator.observer import Observer
from evaluation.undeclared.effects import DRAWABLE
from evaluation.undeclared.expected import expected
from evaluation.undeclared.population import Order
from evaluation.undeclared.record import make
from hil.bench import load_bench, override
from hil.inputs.captured import samples_of
from hil.inputs.declared import device_of, observer_settings_of
from hil.records.capture import read_capture

pytestmark = pytest.mark.slow  # closed loops

SAMPLES = 12_000
CLEAR = 10.0
"""Deviations of an estimate by which at least one coefficient has to stand out, or the comparison says nothing."""


@pytest.mark.beyond(6)
@pytest.mark.parametrize("name", [name for name in DRAWABLE if name in names()])
def test_the_observer_finds_what_is_expected(name: str, tmp_path: Path) -> None:
    place = make(Order("single", (name,), 1, draw=2), tmp_path, SAMPLES)
    truth = json.loads((place / "truth.json").read_text())
    hidden = truth["effects"][0]
    what = expected(name, hidden["tables"], hidden["sections"], truth["device"])
    capture, bench = read_capture(place / "capture.arrow"), load_bench(place / "bench.toml")
    # A high-pass leaks at its own corner.
    corners = {f"leak_{axis}": abs(what.coefficients[f"hp{axis}"]) for axis in "xy" if name == "sense_high_pass"}
    carried = {one: {**corners, **what.parameters} for one in what.names}
    bench = override(bench, {"effects": carried}, name)
    observer = Observer(device_of(bench), observer_settings_of(bench))
    _, sense, drive, _, _ = samples_of(capture)
    innovation = observer.run(sense, drive, temperature=capture.temp_C).innovation[SAMPLES // 2 :]
    assert np.sqrt(np.mean(innovation**2)) < 1.15 * truth["noise_V"]  # fading memory and steps of the rate cost some
    deviations = np.sqrt(np.diagonal(observer.covariance))
    clear = 0.0
    for symbol, true in what.coefficients.items():
        found = observer.state[observer.names.index(symbol)]
        deviation = deviations[observer.estimated.index(symbol)]
        clear = max(clear, abs(true) / deviation)
        # 1 % beside the noise: second-order terms of the catalogue's own approximations.
        assert abs(found - true) < 5.0 * deviation + 0.01 * abs(true), symbol
    assert clear > CLEAR
