"""Plug-ins that misbehave once they have behaved for so many samples: longer than the trial before a board is armed.

Each begins as a quiet observer of a mass at rest, or a controller that drives nothing.
"""

import ctypes
import math
import os
import sys
import time
from typing import Any

import hil

AFTER = 700  # the trial is shorter
GOOD = hil.Estimate(1e-6, 0.0, 0.0, 0.0, 0.0, 0.0, innovation=(0.0, 0.0))


class Quiet:
    """Says nothing new."""

    def __init__(self, device: hil.DeclaredDevice) -> None:
        self.device = device
        self.count = 0

    def observe(self, sense: tuple[float, float], applied: tuple[float, float], imposed: float) -> hil.Estimate:
        self.count += 1
        return self.wrong() if self.count > AFTER else GOOD

    def control(self, estimate: hil.Estimate, on: bool) -> Any:
        self.count += 1
        return self.wrong() if self.count > AFTER else (0.0, 0.0)

    def wrong(self) -> Any:
        raise NotImplementedError


class RaisesAtOnce(Quiet):
    def __init__(self, device: hil.DeclaredDevice) -> None:
        raise ValueError("no such device")


class Raises(Quiet):
    def wrong(self) -> Any:
        raise RuntimeError("lost\nlock")


class NanState(Quiet):
    def wrong(self) -> Any:
        return GOOD._replace(vx=math.nan)


class NanRate(Quiet):
    def wrong(self) -> Any:
        return GOOD._replace(rate=math.nan)


class InfiniteAngle(Quiet):
    def wrong(self) -> Any:
        return GOOD._replace(angle=math.inf)


class InfiniteConstant(Quiet):
    def wrong(self) -> Any:
        return GOOD._replace(constants={"kxx": -math.inf})


class NegativeUncertainty(Quiet):
    def wrong(self) -> Any:
        return GOOD._replace(angle_u=-1.0)


class NegativeDeviation(Quiet):
    def wrong(self) -> Any:
        return GOOD._replace(deviation={"rate": -1e-3})


class NegativeInnovationDeviation(Quiet):
    def wrong(self) -> Any:
        return GOOD._replace(innovation_deviation=(1.0, -1.0))


class NanConstant(Quiet):
    """Which is no fault: the declared one stands in its place."""

    def observe(self, sense: tuple[float, float], applied: tuple[float, float], imposed: float) -> hil.Estimate:
        self.count += 1
        first = 0.0 if self.count <= AFTER else math.nan
        x = 1e-6 * (1.0 + 1e-3 * (self.count % 2))
        return GOOD._replace(x=x, constants={"phi_x": first, "kxy": math.nan})


class UnknownName(Quiet):
    def wrong(self) -> Any:
        return GOOD._replace(constants={"stiffness": 1.0})


class Absurd(Quiet):
    def wrong(self) -> Any:
        return GOOD._replace(x=1e300)


class AbsurdConstant(Quiet):
    def wrong(self) -> Any:
        return GOOD._replace(constants={"kxx": 1e300})


class Holds(Quiet):
    """Follows nothing any more."""

    def wrong(self) -> Any:
        print("still here")  # into whose standard output?
        return GOOD


class WrongShape(Quiet):
    def wrong(self) -> Any:
        import numpy as np

        return GOOD._replace(x=np.zeros(2))  # type: ignore[arg-type]


class NoEstimate(Quiet):
    def wrong(self) -> Any:
        return None


class NanDrive(Quiet):
    def wrong(self) -> Any:
        return math.nan, 0.0


class BeyondLimit(Quiet):
    def wrong(self) -> Any:
        return 0.0, -1.001 * self.device.drive_limit_mps2


class ThreeForces(Quiet):
    def wrong(self) -> Any:
        return [0.0] * 4


class Blocks(Quiet):
    def wrong(self) -> Any:
        while True:
            pass


class Swallows(Quiet):
    def wrong(self) -> Any:
        while True:
            try:
                time.sleep(3600.0)
            except BaseException:  # noqa: BLE001 - that is what it is about
                continue


class Sleeps(Quiet):
    def wrong(self) -> Any:
        time.sleep(0.72)  # the clock of a call goes in steps of 4 ms
        return GOOD


class Crashes(Quiet):
    def wrong(self) -> Any:
        return ctypes.string_at(16)


class Aborts(Quiet):
    def wrong(self) -> Any:
        os.abort()


class Exits(Quiet):
    def wrong(self) -> Any:
        sys.exit(0)


class ExitsAtOnce(Quiet):
    def wrong(self) -> Any:
        os._exit(0)


class Allocates(Quiet):
    def wrong(self) -> Any:
        held = []
        while True:
            held.append(bytearray(1 << 24))


class Leaks(Quiet):
    def __init__(self, device: hil.DeclaredDevice) -> None:
        super().__init__(device)
        self.held: list[bytearray] = []

    def wrong(self) -> Any:
        self.held.append(bytearray(1 << 21))
        return GOOD
