"""A gyro as its bench file declares it, for tests of parts of tracing that never run it."""

from dataclasses import replace

from estimator.settings import Device

NOMINAL = Device(
    sample_rate=4000.0,
    stiffness=(1.6e6, 1.62e6, 0.0),
    damping=(1.0, 1.2, 0.0),
    amplitude=1e-4,
    sense_gain=(-890.0, 900.0),
    noise=(1e-4, 1e-4),
)
UNLIKE = replace(NOMINAL, sense_gain=(-890.0, 445.0))
"""With channels of two gains and signs."""
