"""Captures of sensors that put out rates: a code per axis, status and latency beside it; and what they come to."""

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from hil.records.capture import Capture
from hil.records.layout import HOST, TICK, Column, Layout, block_rows_for
from hil.records.result import Channel, Percentiles, Sensor
from hil.records.summary import percentiles

Floats = npt.NDArray[np.float64]


def rates_layout(
    channels: Sequence[Column], *, tick_rate_Hz: float, device: str, line_s: float | None = None
) -> Layout:
    """Layout of a capture: tick, `channels` as codes with their scales, `status` as sent, `latency_us`, flags.

    A tick is a sample of the sensor, by its own counter; the sensor's clock is the capture's only time. Of a reference
    beside a run `host_ns` says when a sample was read, and `line_s` how long a frame is on its line.
    """
    stamp = () if line_s is None else (Column("host_ns", "i8", "ns", clock=HOST),)
    columns = (
        TICK,
        *channels,
        Column("status", "i8"),
        Column("latency_us", "i4", "µs"),
        *stamp,
        Column("flags", "u1"),
    )
    header = {
        "tick_rate_Hz": tick_rate_Hz,
        "axes": 0,
        "hold": "zoh",
        "latency_ticks": 0,
        "time": "the sensor's counter",
        "identity": {"device": device, **({} if line_s is None else {"line_s": line_s})},
    }
    return Layout("capture", columns, block_rows_for(tick_rate_Hz), header)


def rates_rad_s(capture: Capture) -> dict[str, Floats]:
    """Each rate of a capture (n,), by axis."""
    scales = capture.header["columns"]
    names = [name for name in capture.columns if name.startswith("rate_") and name.endswith("_code")]
    return {name[5:-5]: capture.columns[name] * float(scales[name]["scale"]) for name in names}


_SUFFIXES = {"m/s²": "mps2", "°C": "C", "V": "V", "rad": "rad", "m/s": "mps", "T": "T", "Pa": "Pa", "s": "s"}


def beside_rates(capture: Capture) -> dict[str, Floats]:
    """What a sensor sends beside its rates (n,), in SI units by name: `acc_x_mps2`, `temp_C`."""
    told = capture.header["columns"] if capture.axes == 0 else {}
    return {
        f"{name.removesuffix('_code')}_{_SUFFIXES[told[name]['unit']]}": values * float(told[name]["scale"])
        for name, values in capture.columns.items()
        if name.endswith("_code") and not name.startswith("rate_") and told.get(name, {}).get("unit") in _SUFFIXES
    }


def sensor_figures(capture: Capture, complaints: Callable[[int], list[str]], *, host_rate_Hz: float | None) -> Sensor:
    """Mean, spread and white noise of each axis, status by complaint, latency; `complaints` puts a status in words."""
    channels = {}
    for axis, rate in rates_rad_s(capture).items() if len(capture) else ():
        steps = np.diff(rate)[np.diff(capture.tick) == 1]
        channels[axis] = Channel(
            mean_rad_s=float(rate.mean()),
            sd_rad_s=float(rate.std()),
            noise_rad_s=float(np.sqrt(0.5 * np.mean(steps**2))) if steps.size else None,
        )
    status: dict[str, int] = {}
    for value, count in zip(*np.unique(capture.columns["status"], return_counts=True), strict=True):
        for complaint in complaints(int(value)):
            status[complaint] = status.get(complaint, 0) + int(count)
    latencies = capture.columns["latency_us"].astype(float)
    latency: Percentiles | None = percentiles(latencies[latencies >= 0])
    return Sensor(
        device=str(capture.header["identity"]["device"]),
        sample_rate_Hz=capture.tick_rate_Hz,
        host_rate_Hz=host_rate_Hz,
        channels=channels,
        status=status,
        latency_us=latency,
    )
