"""What moves with a measured temperature, per kelvin from the first reading on."""

import sympy as sp

from estimator.effects.declaration import Coefficient, Effect, Signal, Source, Undone
from estimator.model.gyro import vx, vy, x, y

warmth, ktx, kty, dtx, dty, ptx, pty = sp.symbols("warmth ktx kty dtx dty ptx pty")

_WARMTH = (Signal(warmth, Source.TEMPERATURE),)

TEMPERATURE_STIFFNESS = Effect(
    name="temperature_stiffness",
    title="Stiffness that moves with the temperature",
    coefficients=(Coefficient(ktx, "ktx", 1e-3, 0, -2, -1), Coefficient(kty, "kty", 1e-3, 0, -2, -1)),
    signals=_WARMTH,
    force=(-ktx * warmth * x, -kty * warmth * y),
    source="Young's modulus of silicon, −60 ppm/K; Senturia 2001, ch. 8",
    signature="a slow residual that moves with the temperature channel",
    undone=Undone.CANCEL,
    look_alikes={"ageing": "a temperature cycle"},
)

TEMPERATURE_DAMPING = Effect(
    name="temperature_damping",
    title="Damping that moves with the temperature",
    coefficients=(Coefficient(dtx, "dtx", 1e-4, 0, -1, -1), Coefficient(dty, "dty", 1e-4, 0, -1, -1)),
    signals=_WARMTH,
    force=(-dtx * warmth * vx, -dty * warmth * vy),
    source="gas and thermoelastic damping; Senturia 2001, ch. 8",
    signature="a slow residual that moves with the temperature channel",
    undone=Undone.CANCEL,
    look_alikes={"ageing": "a temperature cycle"},
)

TEMPERATURE_OFFSET = Effect(
    name="temperature_offset",
    title="Sense offset that moves with the temperature",
    coefficients=(Coefficient(ptx, "ptx", 1e-3, 1, 0, -1), Coefficient(pty, "pty", 1e-3, 1, 0, -1)),
    signals=_WARMTH,
    sense=(ptx * warmth, pty * warmth),
    source="drift of the readout; IEEE Std 1431",
    signature="a slow offset that moves with the temperature channel",
    undone=Undone.MAP,
    look_alikes={"ageing": "a temperature cycle"},
)
