"""`characteristics.json`: the figures of a data sheet that records gave. Its JSON Schema is published in
docs/reference/characteristics.schema.json."""

from functools import partial
from typing import Literal

from pydantic import Field

from hil.records import json_file


class SheetRow(json_file.Strict):
    """One figure of one axis. A value that is null is one that the records cannot tell; `said` tells why."""

    axis: str
    figure: str
    title: str
    clause: str = Field(description="Where the figure is defined")
    value: float | None = None
    low: float | None = Field(default=None, description="Ends of the 95 % interval, in the same unit")
    high: float | None = None
    unit: str = Field(description="SI")
    sheet_value: float | None = Field(default=None, description="The value in the unit of data sheets")
    sheet_unit: str
    limit: float | None = Field(default=None, description="[limits] of the bench file, SI; null: none")
    kept: bool | None = Field(
        default=None, description="Whether the limit is kept; false for a figure that is not determined"
    )
    said: str = ""


class Curve(json_file.Strict):
    """Allan deviation of one axis: cluster length, deviation and its 95 % interval, and the power α of the noise."""

    axis: str
    tau_s: tuple[float, ...]
    deviation_rad_s: tuple[float, ...]
    low_rad_s: tuple[float, ...]
    high_rad_s: tuple[float, ...]
    alpha: tuple[int, ...]


class DataSheet(json_file.Sealed):
    """All figures of a device."""

    version: Literal[1] = 1
    device: str
    serial_number: str | None = None
    records: tuple[str, ...]
    seconds: float
    reference: Literal["truth", "rate channel", "reference gyro"] | None = Field(
        default=None,
        description="Source of the true rotation; null: none, and the device is assumed to be at rest",
    )
    verdict: Literal["good", "failed"]
    rows: tuple[SheetRow, ...]
    curves: tuple[Curve, ...] = ()
    remarks: tuple[str, ...] = ()

    def of(self, figure: str, axis: str | None = None) -> SheetRow:
        """The row of a figure, of the first axis or of one. Raises KeyError where there is none."""
        for row in self.rows:
            if row.figure == figure and axis in (None, row.axis):
                return row
        raise KeyError(figure)


save_data_sheet = json_file.save
load_data_sheet = partial(json_file.load, model=DataSheet, give="the folder of a data sheet", anew="characterise again")
