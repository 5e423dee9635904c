"""The cache of compiled kernels: filled by one command, hit by every process after it."""

import os
import subprocess
import sys

import pytest

from estimator.kernel.compiled import is_warm

FIRST_USE = """
import numpy as np
from estimator.observer import Observer
from estimator.settings import ControllerSettings, Device, Gain, ObserverSettings

control = ControllerSettings(latency=1, force_quantum=1e-3, force_limit=10.0, sense_quantum=1e-5)
two = Device(4000.0, (1.6e6, 1.6e6, 0.0), (1.0, 1.0, 0.0), 1e-4, (-890.0, -890.0), (1e-4, 1e-4))
one = Device(4000.0, (1.6e6,), (1.0,), 1e-4, (-890.0,), (1e-4,), drive_gain=2.0)
for gain in Gain:
    observer = Observer(two, ObserverSettings(gain=gain, memory=0.01), control)
    observer.tick(1, 2, 3, 4)
    observer.run(np.zeros((3, 2)), np.zeros((3, 2, 8)), every=2)
    observer.run(np.zeros((3, 2)), np.zeros((3, 2)), truth=np.zeros((3, 13)))
step = np.array([1e-4, 2e-4, 3e-4])
Observer(one, ObserverSettings()).run(np.zeros((3, 1)), np.asfortranarray(np.zeros((3, 1))), step=step)
"""


def python(*arguments: str, **environment: str) -> str:
    done = subprocess.run(
        [sys.executable, *arguments],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=True,
        timeout=300,
    )
    return done.stdout


@pytest.mark.slow
def test_a_process_after_warming_compiles_nothing() -> None:
    warmed = python("-m", "estimator.warm")
    assert "kernels" in warmed
    assert is_warm()
    assert warmed.count("\n") == 1
    log = python("-c", FIRST_USE, NUMBA_DEBUG_CACHE="1")
    assert "data loaded from" in log
    assert "saved to" not in log
