"""A drive chain that pushes otherwise than commanded.  As forces: what is applied beyond the command."""

from estimator.effects.declaration import Coefficient, Compensation, Effect, Parameter, Signal, Source
from estimator.effects.search import Search
from estimator.model.formula import clipped, symbols
from estimator.model.symbols import ux, uy

hx, hy, mx, my, qx, qy, sx, sy, zx, zy, limit, band = symbols("hx hy mx my qx qy sx sy zx zy limit band")

DRIVE_GAIN = Effect(
    name="drive_gain",
    number=11,
    title="Drive gain of each axis",
    coefficients=(Coefficient(hx, "hx", 0.05), Coefficient(hy, "hy", 0.05)),
    force=(hx * ux, hy * uy),
    source="u → G u; IEEE Std 1431",
    signature="scales with the drive only",
    compensation=Compensation.INVERT,
    look_alikes={"stiffness and damping": "steps of the target stiffness"},
    gain=True,
)

DRIVE_MISALIGNMENT = Effect(
    name="drive_misalignment",
    number=12,
    title="Each drive pushes the other axis too",
    coefficients=(Coefficient(mx, "mx", 0.05), Coefficient(my, "my", 0.05)),
    force=(mx * uy, my * ux),
    source="forcer misalignment; IEEE Std 1431",
    signature="scales with the other axis' drive",
    compensation=Compensation.INVERT,
)

ELECTROSTATIC_DRIVE = Effect(
    name="electrostatic_drive",
    number=24,
    title="Force with a term in the square of the drive",
    coefficients=(Coefficient(qx, "qx", 3.0, -1, 2), Coefficient(qy, "qy", 3.0, -1, 2)),
    force=(qx * ux**2, qy * uy**2),
    source="(V + v)² of an electrostatic forcer; Senturia 2001, ch. 6",
    signature="even harmonics of the drive",
    compensation=Compensation.INVERT,
)

DRIVE_SATURATION = Effect(
    name="drive_saturation",
    number=25,
    title="The drive amplifier stops short of what was commanded",
    coefficients=(Coefficient(sx, "sx", 0.5), Coefficient(sy, "sy", 0.5)),
    parameters=(Parameter(limit, "limit", 1, -2),),
    signals=(Signal(limit, Source.PARAMETER),),
    force=(
        sx * (clipped(ux, limit) - ux),
        sy * (clipped(uy, limit) - uy),
    ),
    source="u → clip(u), share s of what goes over the limit is lost",
    signature="a threshold in the drive, odd harmonics",
    compensation=Compensation.INVERT,
    search=Search.LIMITS,
)

DRIVE_DEAD_BAND = Effect(
    name="drive_dead_band",
    number=26,
    title="Small drives do nothing",
    coefficients=(Coefficient(zx, "zx", 0.5, positive=True), Coefficient(zy, "zy", 0.5, positive=True)),
    parameters=(Parameter(band, "band", 1, -2),),
    signals=(Signal(band, Source.PARAMETER),),
    force=(-zx * clipped(ux, band), -zy * clipped(uy, band)),
    source="u → u − clip(u) at the band, share z of it",
    signature="a threshold in the drive, odd harmonics",
    compensation=Compensation.INVERT,
    search=Search.BANDS,
)
