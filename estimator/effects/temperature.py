"""What moves with a measured temperature, per kelvin from the first reading on.

Stiffness and damping are matrices, k(T) and d(T): Young's modulus scales the cross-stiffness with the rest, and a
stress in the package does not; so each entry has a coefficient of its own, and the matrix stays symmetric.
"""

from estimator.effects.declaration import Coefficient, Compensation, Effect, Signal, Source
from estimator.model.formula import symbols
from estimator.model.symbols import vx, vy, x, y

warmth, ktx, kty, ktxy, dtx, dty, dtxy, ptx, pty = symbols("warmth ktx kty ktxy dtx dty dtxy ptx pty")

_WARMTH = (Signal(warmth, Source.TEMPERATURE),)

TEMPERATURE_STIFFNESS = Effect(
    name="temperature_stiffness",
    number=29,
    title="Stiffness that moves with the temperature",
    coefficients=(
        Coefficient(ktx, "ktx", 1e-3, 0, -2, -1),
        Coefficient(kty, "kty", 1e-3, 0, -2, -1),
        Coefficient(ktxy, "ktxy", 1e-3, 0, -2, -1),
    ),
    signals=_WARMTH,
    force=(-warmth * (ktx * x + ktxy * y), -warmth * (ktxy * x + kty * y)),
    source="Young's modulus of silicon, −60 ppm/K; Senturia 2001, ch. 8",
    signature="a slow residual that moves with the temperature channel",
    compensation=Compensation.CANCEL,
    look_alikes={"ageing": "a temperature cycle"},
)

TEMPERATURE_DAMPING = Effect(
    name="temperature_damping",
    number=30,
    title="Damping that moves with the temperature",
    coefficients=(
        Coefficient(dtx, "dtx", 1e-4, 0, -1, -1),
        Coefficient(dty, "dty", 1e-4, 0, -1, -1),
        Coefficient(dtxy, "dtxy", 1e-4, 0, -1, -1),
    ),
    signals=_WARMTH,
    force=(-warmth * (dtx * vx + dtxy * vy), -warmth * (dtxy * vx + dty * vy)),
    source="gas and thermoelastic damping; Senturia 2001, ch. 8",
    signature="a slow residual that moves with the temperature channel",
    compensation=Compensation.CANCEL,
    look_alikes={"ageing": "a temperature cycle"},
)

TEMPERATURE_OFFSET = Effect(
    name="temperature_offset",
    number=31,
    title="Sense offset that moves with the temperature",
    coefficients=(Coefficient(ptx, "ptx", 1e-3, 1, 0, -1), Coefficient(pty, "pty", 1e-3, 1, 0, -1)),
    signals=_WARMTH,
    sense=(ptx * warmth, pty * warmth),
    source="drift of the readout; IEEE Std 1431",
    signature="a slow offset that moves with the temperature channel",
    compensation=Compensation.MAP,
    look_alikes={"ageing": "a temperature cycle"},
)
