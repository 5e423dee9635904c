"""`comparison.json`: what several methods make of one record, a row each. Its JSON Schema is published in
docs/reference/comparison.schema.json."""

from functools import partial
from typing import Annotated, Literal

from pydantic import Field

from hil.errors import InputError
from hil.records import json_file

MethodKind = Literal["observer", "traced", "prior art", "bound"]


NonNegative = Annotated[float, Field(ge=0)]
SheetFigures = dict[str, tuple[float, float, float]]


class MethodRow(json_file.Strict):
    """One method. Null: the method has no such figure, or the record no reference for it."""

    name: str
    kind: MethodKind
    record: Literal["this", "its own"] = Field(
        description="its own: the method closed the loop itself, on the same emulated device with the same seed"
    )
    angle_rad: float | None = Field(default=None, description="Change of the angle over the scored window")
    angle_u_rad: NonNegative | None = Field(
        default=None, description="Its standard uncertainty (k = 1), as the method states it"
    )
    angle_expanded_rad: NonNegative | None = Field(default=None, description="Its expanded uncertainty (k = 2)")
    angle_error_rms_rad: NonNegative | None = Field(
        default=None, description="Angle less the reference's, both zero at the start of the scored window"
    )
    angle_error_max_rad: NonNegative | None = None
    rate_error_rms_rad_s: NonNegative | None = None
    rate_expanded_rad_s: NonNegative | None = Field(
        default=None, description="Expanded (k = 2): twice the rms of the deviation it states"
    )
    stiffness_error: NonNegative | None = Field(
        default=None, description="rms of the errors of kxx, kyy and kxy at the end, over the target stiffness"
    )
    stiffness_expanded: NonNegative | None = Field(
        default=None, description="Expanded (k = 2): twice the rms of the deviations it states"
    )
    damping_error: NonNegative | None = Field(
        default=None, description="rms of the errors of dxx, dyy and dxy at the end, over the true mean of dxx and dyy"
    )
    damping_expanded: NonNegative | None = None
    settled_s: NonNegative | None = Field(
        default=None,
        description="Bench time from which on the angle's error stays within 20 mrad of its mean over the scored "
        "window; null where it never does, or for less than its last tenth",
    )
    diverged_s: NonNegative | None = Field(
        default=None,
        description="Bench time from which on the method had lost the device: figures that are not finite, an "
        "innovation beyond [limits] residual_safe, or an angle off by more than a quarter of a turn for good",
    )
    cost_us: NonNegative | None = Field(default=None, description="Processor time a sample, on this machine")
    sheet: SheetFigures = Field(
        default_factory=dict,
        description="Figures of a data sheet by the names of hil characterise: value and 95 % interval, SI",
    )
    remark: str = ""


class Methods(json_file.Sealed):
    """All methods on one record."""

    version: Literal[2] = 2
    record: str
    bench: str
    seconds: NonNegative
    window_s: tuple[float, float] = Field(description="The scored window, bench time")
    reference: Literal["truth", "rate channel", "reference gyro"] | None = Field(
        default=None, description="Reference of the errors; null: none, and there are no errors"
    )
    rows: tuple[MethodRow, ...]
    remarks: tuple[str, ...] = Field(default=(), description="What could not be compared, and why, a line each")

    def of(self, name: str) -> MethodRow:
        """The row of that name. Raises InputError with the names there are."""
        for row in self.rows:
            if row.name == name:
                return row
        raise InputError(f"{name}: no such method; there are {', '.join(row.name for row in self.rows)}")


save_methods = json_file.save
load_methods = partial(
    json_file.load, model=Methods, give="the folder of a comparison", anew="compare again to write it anew"
)
