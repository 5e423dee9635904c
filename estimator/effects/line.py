"""A sinusoid that is not the gyro's: on the sense side, or as a force.  Its frequency is found, not given."""

from estimator.effects.declaration import Coefficient, Compensation, Effect, Parameter, Signal, Source
from estimator.effects.search import Search
from estimator.model.formula import symbols

omega, cosine, sine = symbols("omega cosine sine")
lcx, lsx, lcy, lsy, bcx, bsx, bcy, bsy = symbols("lcx lsx lcy lsy bcx bsx bcy bsy")

_SIGNALS = (Signal(cosine, Source.COSINE), Signal(sine, Source.SINE))
_OMEGA = (Parameter(omega, "omega", 0, -1),)

INTERFERENCE = Effect(
    name="interference",
    number=27,
    title="A line of another source in the sensed signal",
    coefficients=tuple(Coefficient(symbol, symbol.name, 0.02, 1) for symbol in (lcx, lsx, lcy, lsy)),
    parameters=_OMEGA,
    signals=_SIGNALS,
    sense=(lcx * cosine + lsx * sine, lcy * cosine + lsy * sine),
    source="coupled-in line, V + a sin(ωt + ψ)",
    signature="one line, unrelated to the drive",
    compensation=Compensation.MAP,
    look_alikes={"base_vibration": "nothing, where both axes see it"},
    search=Search.LINES,
)

BASE_VIBRATION = Effect(
    name="base_vibration",
    number=28,
    title="The base shakes at one frequency",
    coefficients=tuple(Coefficient(symbol, symbol.name, 0.02, 1, -2) for symbol in (bcx, bsx, bcy, bsy)),
    parameters=_OMEGA,
    signals=_SIGNALS,
    force=(bcx * cosine + bsx * sine, bcy * cosine + bsy * sine),
    source="inertial force of a vibrating package; IEEE Std 1431",
    signature="one line, unrelated to the drive",
    compensation=Compensation.CANCEL,
    look_alikes={"interference": "nothing, where both axes see it"},
    search=Search.LINES,
)
