"""What may be asked of a characterisation beside its records: one declaration, from which every caller takes its
options.
"""

from pathlib import Path
from typing import Annotated

from annotated_types import Ge, Gt, Le
from typing_extensions import TypedDict

from hil.options import Called, Default, Help, Names
from hil.records.run_name import RunNameOption


class CharacteriseOptions(TypedDict, total=False):
    """What may be asked of it from wherever."""

    name: RunNameOption
    duration_s: Annotated[
        Annotated[float, Gt(0.0), Le(1e6)] | None, Help("Of a LINK: seconds that are recorded first.  [default: 60]")
    ]
    temperature_C: Annotated[
        Annotated[float, Ge(-273.15), Le(1000.0)] | None,
        Called("temperature"),
        Help("Temperature of the device in °C where the record has none; kept with the calibration."),
    ]
    report: Annotated[bool, Default(True), Help("Draw report.html; leave it out to save time on many records.")]


class LocalCharacteriseOptions(CharacteriseOptions, total=False):
    """And what names a file of this machine."""

    truth: Annotated[
        Names, Called("truth"), Help("File that the emulated board of a run wrote: how it turned. One for each run.")
    ]
    calibrate: Annotated[
        Path | str | None,
        Called("calibrate"),
        Help("Folder, as calibrations: keep there, as SERIAL.toml, what depends on the angle."),
    ]
    junit: Annotated[Path | str | None, Called("junit"), Help("Write the limits, kept or not, as JUnit XML too.")]
    replace: Annotated[bool, Help("Overwrite an existing file.")]
