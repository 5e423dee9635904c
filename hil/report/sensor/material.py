"""What the page of a recorded rate sensor is made of: its capture, its figures, and the noise read off them."""

import math
from functools import cached_property

import numpy as np
import numpy.typing as npt

from estimator.allan.deviation import allan_deviation
from estimator.allan.noise import Noise, read_noise
from hil.errors import InputError
from hil.records.capture import Capture
from hil.records.rates import rates_rad_s
from hil.records.result import Channel, Result, Sensor
from hil.records.runfolder import RunFolder
from hil.report.material import Material

Floats = npt.NDArray[np.float64]

_MOVED = 3.0


class SensorMaterial:
    """One recording, read once. Raises InputError where the folder is not that of a recorded sensor."""

    def __init__(self, folder: RunFolder) -> None:
        self.run = Material(folder)
        capture, result = folder.capture, folder.result
        if capture is None or capture.axes or result is None or result.sensor is None:
            raise InputError(f"{folder.path}: no record of a rate sensor with its result.json; make one by hil record")
        self.capture: Capture = capture
        self.result: Result = result
        self.sensor: Sensor = result.sensor

    @cached_property
    def rates_rad_s(self) -> dict[str, Floats]:
        """Each rate (n,), by axis; none of a record that was ended before its first row."""
        return rates_rad_s(self.capture) if len(self.capture) else {}

    @cached_property
    def noise(self) -> dict[str, Noise]:
        """Allan deviation of each axis and what it tells."""
        rate_Hz = self.capture.tick_rate_Hz
        return {
            axis: read_noise(allan_deviation(rate, self.capture.tick, rate_Hz))
            for axis, rate in self.rates_rad_s.items()
        }

    @cached_property
    def unbroken(self) -> slice:
        """Rows of the longest stretch without a gap."""
        edges = [0, *(np.flatnonzero(np.diff(self.capture.tick) != 1) + 1).tolist(), len(self.capture)]
        longest = max(range(len(edges) - 1), key=lambda k: edges[k + 1] - edges[k])
        return slice(edges[longest], edges[longest + 1])

    @property
    def apart_ppm(self) -> float | None:
        """By how much the sensor's samples come faster on this machine's clock than they should."""
        measured, nominal = self.sensor.host_rate_Hz, self.sensor.sample_rate_Hz
        return None if measured is None else 1e6 * (measured / nominal - 1.0)

    def moved(self, axis: str) -> bool:
        """Whether an axis spreads much wider than the differences of its neighbouring samples account for."""
        channel: Channel = self.sensor.channels[axis]
        return bool(channel.noise_rad_s) and channel.sd_rad_s > _MOVED * (channel.noise_rad_s or math.inf)
