"""`python -m evaluation.two_loops`: how far two loops come apart in ten turns that differ by next to nothing.

S-slow at 90 °/s; each loop is closed by its own drive, through its estimator as `hil generate` writes it.  Beside the
loop in double: the same in 32 bits, and loops in double of which one sense code was one higher, once.  From the first
drive code on that differs, the converter rounds another motion: its errors, q / √12 rms, are others, as of another
board.  They make √2 (q / √12) / noise of the error that the noise makes of the angle; that is the distance to expect.
A converter of 24 bits has next to none and shows what the arithmetic does.
"""

import argparse
import ctypes
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import hil
from device_emulator.device import Device
from device_emulator.scenario import Scenario, load
from estimator.core.compiler import command
from hil.bench.examples import find

RATE_RAD_S, TURNS, SAMPLE_RATE_HZ = 0.5 * np.pi, 10, 4000
CLOSED_AT, SCORED_AT = 400, 6000
"""Samples."""
SAMPLES = round(TURNS * 2.0 * np.pi / RATE_RAD_S * SAMPLE_RATE_HZ)
DISTURBED_AT = (500, 1000, 2000, 3000, 4000, 5000)
"""Samples of which one code is one higher, one in each loop."""

Codes = tuple[int, int]


def scenario(sense_bits: int = 16) -> Scenario:
    """S-slow at that constant rate, with a converter of so many bits."""
    what = load(find("scenario", "s-slow")).model_dump()
    what["sense"]["adc_bits"] = sense_bits
    return Scenario.model_validate(what | {"rate": {"kind": "constant", "rate_rad_s": RATE_RAD_S}})


def written(folder: Path, *, float32: bool, sense_bits: int = 16) -> Path:
    """The estimator of S-slow for such a converter, compiled: a library in `folder`."""
    scale = load(find("scenario", "s-slow")).sense.adc_full_scale_V / 2.0 ** (sense_bits - 1)
    hil.generate("s-slow", out=folder, float32=float32, sense_scale=scale)
    library = folder / "library.so"
    options = ("-std=c99", "-O2", "-ffp-contract=off", "-shared", "-fPIC")
    subprocess.run([*command(), *options, "-o", library, folder / "gyro_estimator.c", "-lm"], check=True)
    return library


class Generated:
    """A new estimator of a library that `written` made."""

    def __init__(self, library: Path) -> None:
        self._c = ctypes.CDLL(str(library))
        self._c.gyro_estimator_size.restype = ctypes.c_size_t
        self._estimator = ctypes.create_string_buffer(self._c.gyro_estimator_size())
        self._c.gyro_estimator_init(self._estimator)
        text = library.with_name("gyro_estimator.h").read_text()
        values = dict(line.split()[1:3] for line in text.splitlines() if "SCALE" in line)
        self._scale = float(values["GYRO_SENSE_SCALE_V"]), float(values["GYRO_DRIVE_SCALE_MPS2"])
        two: Any = (ctypes.c_float if "typedef float gyro_real;" in text else ctypes.c_double) * 2
        self._sense, self._applied, self._drive, self._angle = two(), two(), two(), ctypes.c_double()

    def step(self, sense: Codes, applied: Codes, closed: bool) -> tuple[float, Codes]:
        """Angle [rad] and drive codes from a sample's codes."""
        self._sense[:] = [code * self._scale[0] for code in sense]
        self._applied[:] = [code * self._scale[1] for code in applied]
        angle = ctypes.byref(self._angle)
        self._c.estimator_step(self._estimator, self._sense, self._applied, int(closed), self._drive, angle)
        ux, uy = (round(u / self._scale[1]) for u in self._drive)
        return self._angle.value, (ux, uy)


def closed_by(own: Generated, board: Scenario, *beside: Generated, disturbed_at: int = -1) -> NDArray[np.float64]:
    """Angles [rad] (samples, 1 + beside) of a loop that `own` closes, and of estimators that are given its samples."""
    device, held = Device(board), (0, 0)
    angles = np.zeros((SAMPLES, 1 + len(beside)))
    for m in range(SAMPLES):
        vx, vy = device.rows([held])[0].tolist()
        sense, closed = (vx + (m == disturbed_at), vy), m >= CLOSED_AT
        for k, other in enumerate(beside):
            angles[m, 1 + k], _ = other.step(sense, held, closed)
        angles[m, 0], drive = own.step(sense, held, closed)
        held = drive if closed else (0, 0)
    return angles


def apart(one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """Difference of two angles [rad] over the scored part, less that at its begin."""
    difference = (one - other)[SCORED_AT:]
    return np.asarray(difference - difference[0])


def main() -> None:
    """Print a table for each converter."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bits", type=int, nargs="+", default=[16, 24], help="of the converter [16 24]")
    bits = parser.parse_args().bits
    turned = RATE_RAD_S * np.arange(SAMPLES) / SAMPLE_RATE_HZ
    print("mrad                              rms      end  largest")
    for of_converter in bits:
        board = scenario(of_converter)
        with tempfile.TemporaryDirectory() as aside:
            short, double = (written(Path(aside) / str(n), float32=n == 32, sense_bits=of_converter) for n in (32, 64))
            plain = closed_by(Generated(double), board)[:, 0]
            wrong = apart(plain, turned)
            code = 2.0 * board.sense.adc_full_scale_V / 2.0**of_converter
            expected = np.sqrt(np.mean(wrong**2)) * np.sqrt(2.0 / 12.0) * code / board.sense.noise_V
            print(f"{of_converter} bits, to expect of the rounding {1e3 * expected:7.4f}")
            shown("in double, beside the truth", wrong)
            both = closed_by(Generated(short), board, Generated(double))
            shown("in 32 bits, same samples", apart(both[:, 0], both[:, 1]))
            shown("in 32 bits, its own loop", apart(both[:, 0], plain))
            for m in DISTURBED_AT:
                other = closed_by(Generated(double), board, disturbed_at=m)[:, 0]
                shown(f"in double, a code at {m}", apart(other, plain))


def shown(name: str, difference: NDArray[np.float64]) -> None:
    """Print a row in mrad."""
    figures = np.sqrt(np.mean(difference**2)), difference[-1], np.abs(difference).max()
    print(f"  {name:27}", *(f"{1e3 * figure:8.4f}" for figure in figures), flush=True)


if __name__ == "__main__":
    main()
