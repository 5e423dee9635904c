"""What may be asked of an identification beside the link: every caller takes its options from here."""

from typing import Annotated

from annotated_types import Gt, MaxLen
from typing_extensions import TypedDict

from hil.options import Called, Default, Help, Like, Names
from hil.records.kind import RUN_NAME


class IdentifyOptions(TypedDict, total=False):
    """What may be asked of it from wherever; what is not told stays the board's own: its converters' ranges."""

    sense_limit_V: Annotated[
        Annotated[float, Gt(0.0)] | None,
        Called("sense_limit"),
        Help("Sense voltage beyond which nothing is driven on, V.  [default: 0.6 of the converter's range]"),
    ]
    drive_limit_mps2: Annotated[
        Annotated[float, Gt(0.0)] | None,
        Called("drive_limit"),
        Help("Largest drive, m/s².  [default: 0.9 of the converter's range]"),
    ]
    mass_kg: Annotated[
        Annotated[float, Gt(0.0)] | None,
        Called("mass"),
        Help("Proof mass, kg, which no record tells; also tells the thermal noise."),
    ]
    temperature_K: Annotated[
        Annotated[float, Gt(0.0)] | None, Called("temperature"), Default(300.0), Help("Of the proof mass, K.")
    ]
    amplitude_m: Annotated[
        Annotated[float, Gt(0.0)] | None,
        Called("amplitude"),
        Help("Amplitude to run with, m.  [default: what drive and range allow]"),
    ]
    angle_noise_rad: Annotated[
        Annotated[float, Gt(0.0)] | None,
        Called("angle_noise"),
        Help("Noise of the angle that is wanted, rad rms: what limits it is told where it is not reached."),
    ]
    bandwidth_Hz: Annotated[
        Annotated[float, Gt(0.0)] | None,
        Called("bandwidth"),
        Help("Bandwidth of the angle that is wanted, Hz: what limits it is told where it is not reached."),
    ]
    like: Annotated[
        Annotated[str, MaxLen(200)] | None,
        Help("Bench file or example that declares the device; what the board does is held against it."),
    ]
    name: Annotated[
        Annotated[str, MaxLen(60), Like(RUN_NAME)] | None,
        Help("Name of the device, in file and reports.  [default: that of the bench file]"),
    ]


class LocalIdentifyOptions(IdentifyOptions, total=False):
    """And what names a file of this machine."""

    record: Annotated[Names, Help("Run folder or capture to take instead of an experiment; may be repeated.")]
    replace: Annotated[bool, Help("Overwrite an existing file.")]
