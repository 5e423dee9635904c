"""`hil generate --float32`: what 32 bits round off does not add up in the angle."""

import ctypes
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hil
from device_emulator.device import Device
from device_emulator.scenario import Scenario, load
from hil.bench.examples import find
from tests.codegen.test_generate import STRICT

TURN_S = 4.0  # at a quarter of a turn a second
LINK = f"inproc:{find('scenario', 's-slow')}"
CLOSED_AT, SCORED_AT = 400, 6000  # samples


class Generated:
    """The estimator of S-slow as a library."""

    def __init__(self, folder: Path, *, float32: bool) -> None:
        hil.generate("s-slow", out=folder, link=LINK, float32=float32)
        library = folder / "library.so"
        subprocess.run(
            ["cc", *STRICT, "-shared", "-fPIC", "-o", library, folder / "gyro_estimator.c", "-lm"], check=True
        )
        self._c = ctypes.CDLL(str(library))
        self._c.gyro_estimator_size.restype = ctypes.c_size_t
        self._estimator = ctypes.create_string_buffer(self._c.gyro_estimator_size())
        self._c.gyro_estimator_init(self._estimator)
        two: Any = (ctypes.c_float if float32 else ctypes.c_double) * 2
        self._sense, self._applied, self._drive, self._angle = two(), two(), two(), ctypes.c_double()
        values = dict(
            line.split()[1:3] for line in (folder / "gyro_estimator.h").read_text().splitlines() if "SCALE" in line
        )
        self._scale = float(values["GYRO_SENSE_SCALE_V"]), float(values["GYRO_DRIVE_SCALE_MPS2"])

    def step(self, sense: tuple[int, int], applied: tuple[int, int], closed: bool) -> tuple[float, tuple[int, int]]:
        """Angle and drive codes from a sample's codes."""
        self._sense[:] = [code * self._scale[0] for code in sense]
        self._applied[:] = [code * self._scale[1] for code in applied]
        angle = ctypes.byref(self._angle)
        self._c.estimator_step(self._estimator, self._sense, self._applied, int(closed), self._drive, angle)
        ux, uy = (round(u / self._scale[1]) for u in self._drive)
        return self._angle.value, (ux, uy)


@pytest.mark.slow
def test_in_ten_turns_its_angle_is_that_of_double(tmp_path: Path) -> None:
    """Of the same samples, of a loop that it closes itself: two loops come apart by more, whatever their arithmetic, as
    soon as they differ by one code."""
    what = load(find("scenario", "s-slow")).model_dump()
    device = Device(Scenario.model_validate(what | {"rate": {"kind": "constant", "rate_rad_s": 0.5 * np.pi}}))
    short, double = (Generated(tmp_path / str(bits), float32=bits == 32) for bits in (32, 64))
    held, angles = (0, 0), np.zeros((round(10 * TURN_S * 4000), 2))
    for m in range(len(angles)):
        sense, closed = device.rows([held])[0].tolist(), m >= CLOSED_AT
        angles[m, 1], _ = double.step(sense, held, closed)
        angles[m, 0], drive = short.step(sense, held, closed)
        held = drive if closed else (0, 0)
    assert angles[-1, 1] / (2 * np.pi) == pytest.approx(10.0, abs=0.05)
    apart = (angles[:, 0] - angles[:, 1])[SCORED_AT:]
    assert np.abs(apart - apart[0]).max() < 1e-4
