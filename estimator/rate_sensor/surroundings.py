"""What moves the output though nothing turns."""

import numpy as np

from estimator.rate_sensor.declaration import Effect, Stage
from estimator.rate_sensor.record import SensorRecord
from estimator.scaling import Array
from estimator.trace.likelihood import Size


def _warmth(record: SensorRecord) -> Array:
    assert record.temperature is not None  # effects of temperature need its channel
    return np.asarray(record.temperature - np.mean(record.temperature))


DRIFT = Effect(
    name="drift",
    title="Drift of the offset",
    equations=("V → V + r t",),
    coefficients=(Size("r", "V/s"),),
    stage=Stage.SURROUNDINGS,
    act=lambda volts, c, record, declared: c[0] * (record.time - np.mean(record.time)),
    bounds=lambda record, declared: ((-declared.volts, declared.volts),),
    source="IEEE Std 1431, drift rate ramp",
    compensation="the offset is estimated again and again",
    needs="time",
    look_alikes={"temperature_offset": "keep the temperature, or change it both ways"},
)

TEMPERATURE_OFFSET = Effect(
    name="temperature_offset",
    title="Offset that moves with the temperature",
    equations=("V → V + b (T − T̄)",),
    coefficients=(Size("b", "V/K"),),
    stage=Stage.SURROUNDINGS,
    act=lambda volts, c, record, declared: c[0] * _warmth(record),
    bounds=lambda record, declared: ((-declared.volts, declared.volts),),
    source="IEEE Std 1431, bias temperature sensitivity",
    compensation="the offset follows the temperature channel",
    needs="temperature",
    look_alikes={"drift": "keep the temperature, or change it both ways"},
)

TEMPERATURE_SCALE = Effect(
    name="temperature_scale",
    title="Scale factor that moves with the temperature",
    equations=("Ω → Ω (1 + s (T − T̄))",),
    coefficients=(Size("s", "1/K"),),
    stage=Stage.CHARACTERISTIC,
    act=lambda rate, c, record, declared: c[0] * _warmth(record) * rate,
    bounds=lambda record, declared: ((-0.1, 0.1),),
    source="IEEE Std 1431, scale factor temperature sensitivity",
    compensation="the scale factor follows the temperature channel",
    needs="temperature",
)
