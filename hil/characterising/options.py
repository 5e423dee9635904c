"""What may be asked of a characterisation beside its records: one declaration, from which every caller takes its
options.
"""

from pathlib import Path
from typing import Annotated

from annotated_types import Ge, Gt, Le
from typing_extensions import TypedDict

from hil.options import Called, Default, Help, Names
from hil.records.kind import RunNameOption


class CharacteriseOptions(TypedDict, total=False):
    """What may be asked of it from wherever."""

    name: RunNameOption
    duration_s: Annotated[
        Annotated[float, Gt(0.0), Le(1e6)] | None, Help("With a LINK: seconds to record first.  [default: 60]")
    ]
    temperature_C: Annotated[
        Annotated[float, Ge(-273.15), Le(1000.0)] | None,
        Called("temperature"),
        Help("Temperature of the device in °C, for a record without one; stored with the calibration."),
    ]
    report: Annotated[bool, Default(True), Help("Draw report.html; leave it out to save time on many records.")]


class LocalCharacteriseOptions(CharacteriseOptions, total=False):
    """And what names a file of this machine."""

    truth: Annotated[
        Names, Called("truth"), Help("True states that the emulated board of a run wrote; one file for each run.")
    ]
    calibrate: Annotated[
        Path | str | None,
        Called("calibrate"),
        Help("Folder for calibrations: write the errors that depend on the angle there, as SERIAL.toml."),
    ]
    junit: Annotated[Path | str | None, Called("junit"), Help("Write the limits, kept or not, as JUnit XML too.")]
    replace: Annotated[bool, Help("Overwrite an existing file.")]
