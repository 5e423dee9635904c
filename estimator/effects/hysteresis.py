"""Forces that remember where the mass has been: a spring that slips, a foot with play."""

from estimator.effects.declaration import Coefficient, Compensation, Effect, Signal, Source
from estimator.model.formula import symbols

khx, khy, reach, slipx, slipy = symbols("khx khy reach slipx slipy")
kpx, kpy, half_width, stopx, stopy = symbols("kpx kpy half_width stopx stopy")

HYSTERETIC_STIFFNESS = Effect(
    name="hysteretic_stiffness",
    number=41,
    rare=True,
    title="A spring that slips: hysteresis",
    coefficients=(
        Coefficient(khx, "khx", 0.02, 0, -2, positive=True),
        Coefficient(khy, "khy", 0.02, 0, -2, positive=True),
        Coefficient(reach, "reach", 0.2, 1, positive=True, start=0.2, least=0.01),
    ),
    signals=(Signal(slipx, Source.SLIP, 0, reach), Signal(slipy, Source.SLIP, 1, reach)),
    force=(-khx * slipx, -khy * slipy),
    source="Bouc 1967; Wen, J. Eng. Mech. Div. ASCE 102(EM2), 1976, with exponent 1 and β = γ; its first loading is "
    "that of Dahl, Aerospace Corp. TOR-0158(3107-18)-1, 1968, kh the rest stiffness and kh reach the Coulomb force",
    signature="a loss a cycle, and a stiffness, that fall with the amplitude and hardly depend on the frequency",
    compensation=Compensation.NONE,
    look_alikes={"dry_friction": "amplitudes near the reach", "nonlinear_damping": "steps of amplitude"},
)

PLAY = Effect(
    name="play",
    number=43,
    rare=True,
    title="An elastic element whose foot follows with play",
    coefficients=(
        Coefficient(kpx, "kpx", 0.02, 0, -2, positive=True),
        Coefficient(kpy, "kpy", 0.02, 0, -2, positive=True),
        Coefficient(half_width, "half_width", 0.2, 1, positive=True, start=0.2, least=0.01),
    ),
    signals=(Signal(stopx, Source.STOP, 0, half_width), Signal(stopy, Source.STOP, 1, half_width)),
    force=(-kpx * stopx, -kpy * stopy),
    source="the foot z = max(x − w, min(x + w, z)) is the play operator, x − z the stop; Visintin, Differential Models "
    "of Hysteresis, 1994, ch. III; Krejčí, Hysteresis, Convexity and Dissipation, 1996; Prandtl, ZAMM 8, 1928: a "
    "spring behind Coulomb friction of kp w",
    signature="nothing below the half-width; beyond it a loss of 4 kp w (A − w) a cycle, and a stiffness that falls",
    compensation=Compensation.NONE,
    look_alikes={"hysteretic_stiffness": "amplitudes near the half-width", "dry_friction": "steps of amplitude"},
)
