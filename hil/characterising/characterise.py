"""Records of a device to the figures of its data sheet, each beside its limit."""

import datetime
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from estimator.characteristics.rate_error import Line
from estimator.characteristics.stretches import HARMONICS
from estimator.side_by_side import one_blas_thread, side_by_side
from hil.bench.angle_map import Calibrated, Harmonics, write_angle_map
from hil.bench.data_sheet import AT_LEAST, FIGURES, SheetFigure
from hil.characterising.figures import AT_REST, HALVED, AxisFigures, figures_of, lasting
from hil.characterising.page import write_report
from hil.characterising.request import CharacteriseRequest
from hil.characterising.source import Axis, axes_of, cuts_of
from hil.errors import InputError
from hil.progress import Progress, Watcher
from hil.records.atomic import make_run_folder, require_place, write_text
from hil.records.data_sheet import Curve, DataSheet, SheetRow, save_data_sheet
from hil.records.junit import Case, junit_xml
from hil.records.runfolder import RunFolder


@dataclass(frozen=True)
class Characterised:
    """Where the figures were written (characteristics.json, report.html), what they are, and the calibration kept."""

    folder: Path
    sheet: DataSheet
    calibration: Path | None = None


def characterise(request: CharacteriseRequest, out: Path, *, progress: Watcher) -> Characterised:
    """The figures of the records, into a new folder below `out`.

    Raises InputError for a record without a rate, for records of different axes, and where nothing can be kept that was
    to be kept; nothing is left then.
    """
    require_place(out)
    with one_blas_thread():  # its products are short: a second thread only waits for the first
        told, seconds = _told(request, progress)
    device, serial = _device(request)
    sheet = _sheet(request, told, device, serial, seconds)
    kept = None if request.calibrate is None else _calibration(request, told, serial, seconds)
    folder = make_run_folder(out, request.name)
    save_data_sheet(folder / "characteristics.json", sheet)
    if request.report:
        progress(Progress("report", 0, 0))
        write_report(folder, sheet, told)
    if kept is not None and request.calibrate is not None:
        write_angle_map(place := request.calibrate / f"{kept.serial_number}.toml", kept)
    if request.junit is not None:
        write_text(request.junit, junit_xml(cases(sheet), f"{device}: data sheet"))
    return Characterised(folder, sheet, None if kept is None else place)


def _told(request: CharacteriseRequest, progress: Watcher) -> tuple[list[AxisFigures], float]:
    """The figures of each axis, and the length of all records."""
    records: list[list[Axis]] = []
    for number, place in enumerate(request.records):
        truth = request.truth[number] if request.truth else None
        records.append(axes_of(place, request.bench, truth))
    names = [[axis.name for axis in one] for one in records]
    if other := next((number for number, one in enumerate(names) if one != names[0]), 0):
        raise InputError(
            f"{request.records[other]}: has {', '.join(names[other])}, and {request.records[0]} has "
            f"{', '.join(names[0])}; characterise records of one device"
        )
    count = len(names[0])
    axes = [partial(figures_of, [one[number] for one in records]) for number in range(count)]
    told = side_by_side(axes, lambda finished: progress(Progress("axes", finished, count)))
    return told, sum(one[0].span / one[0].rate_Hz for one in records)


def _device(request: CharacteriseRequest) -> tuple[str, str | None]:
    """Its name and its serial number."""
    folder = RunFolder(request.records[0] if request.records[0].is_dir() else request.records[0].parent)
    result = folder.result
    name = None if request.bench is None else request.bench.device.name
    if name is None and result is not None and result.sensor is not None:
        name = result.sensor.device
    return name or request.records[0].stem, None if result is None else result.serial_number


def _sheet(
    request: CharacteriseRequest, told: list[AxisFigures], device: str, serial: str | None, seconds: float
) -> DataSheet:
    rows = tuple(row for axis in told for row in _rows(request, axis))
    against = any(row.kept is False for row in rows)
    referred = any(axis.referred for axis in told)
    remarks = [cut for place in request.records for cut in cuts_of(place)]
    remarks += [] if referred else [f"no reference for the rotation of the device; bias {AT_REST}"]
    remarks += [remark for axis in told for remark in axis.remarks]
    return DataSheet(
        device=device,
        serial_number=serial,
        records=tuple(str(place) for place in request.records),
        seconds=seconds,
        reference=_reference(request) if referred else None,
        verdict="failed" if against else "good",
        rows=rows,
        curves=tuple(curve for axis in told if (curve := _curve(axis)) is not None),
        remarks=tuple(remarks),
    )


def _reference(request: CharacteriseRequest) -> Literal["truth", "rate channel", "reference gyro"]:
    if request.truth:
        return "truth"
    place = request.records[0]
    capture = RunFolder(place if place.is_dir() else place.parent).capture
    return (
        "rate channel" if capture is None or capture.rate_rad_s is not None or capture.axes == 0 else "reference gyro"
    )


def _rows(request: CharacteriseRequest, told: AxisFigures) -> list[SheetRow]:
    """A row for each figure that the device can have."""
    found = []
    for figure in FIGURES:
        limit = None if request.bench is None else getattr(request.bench.limits, figure.key)
        if figure.name in told.found or figure.name in told.missing or limit is not None:
            found.append(_row(figure, told, limit))
    return found


def _row(figure: SheetFigure, told: AxisFigures, limit: float | None) -> SheetRow:
    row = SheetRow(
        axis=told.axis, figure=figure.name, title=figure.title, clause=figure.clause, unit=figure.unit,
        sheet_unit=figure.field.symbol, limit=limit,
    )  # fmt: skip
    estimate = told.found.get(figure.name)
    if estimate is None or not np.isfinite(estimate[:3]).all():
        said = told.missing.get(figure.name, "this device has none")
        return row.model_copy(update={"said": said, "kept": None if limit is None else False})
    kept, said = None, estimate.said
    if limit is not None:
        size = estimate.size
        kept = size.value >= limit if figure.name in AT_LEAST else size.value <= limit
        if not kept and HALVED in estimate.said:
            needed = lasting(told.seconds * (estimate.value / limit) ** 2)
            said = f"upper limit (95 %); one below the limit needs about {needed}"
        elif size.low < limit < size.high:
            said = "; ".join(filter(None, (said, "the limit lies within the interval")))
    return row.model_copy(
        update={
            "value": estimate.value,
            "low": estimate.low,
            "high": estimate.high,
            "sheet_value": figure.shown(estimate.value),
            "kept": kept,
            "said": said,
        }
    )


def _curve(told: AxisFigures) -> Curve | None:
    if told.noise is None or not len(told.noise.curve):
        return None
    curve = told.noise.curve
    low, high = curve.interval(0.95)
    return Curve(
        axis=told.axis, tau_s=tuple(curve.tau_s), deviation_rad_s=tuple(curve.deviation), low_rad_s=tuple(low),
        high_rad_s=tuple(high), alpha=tuple(curve.alpha.astype(int)),
    )  # fmt: skip


def _calibration(
    request: CharacteriseRequest, told: list[AxisFigures], serial: str | None, seconds: float
) -> Calibrated:
    """What depends on the angle.  Raises InputError where the records do not tell it."""
    axis = next((one for one in told if one.line is not None and one.line.angles), None)
    if axis is None or axis.line is None or axis.stretches is None or axis.stretches.reference is None:
        raise InputError(
            f"--calibrate: {request.records[0]} does not tell what depends on the angle; give a whole-angle run with a "
            "reference (--truth, or a rate channel), whose pattern passed all angles"
        )
    if any(name.endswith("theta") for name in axis.line.confounded):
        raise InputError(
            f"--calibrate: {request.records[0]} does not tell what depends on the angle apart from the rest; give "
            "one run each way round"
        )
    if serial is None:
        raise InputError(f"--calibrate: {request.records[0]} has no serial number; give a run of a board")
    rates = axis.stretches.reference
    return Calibrated(
        serial_number=serial,
        date=datetime.datetime.now(datetime.UTC).date(),
        temperature_C=request.temperature_C,
        least_rate_rad_s=float(rates.min()),
        most_rate_rad_s=float(rates.max()),
        seconds=seconds,
        records=tuple(place.name for place in request.records),
        bias_rad_s=_harmonics(axis.line, "bias"),
        scale_factor=_harmonics(axis.line, "scale"),
    )


def _harmonics(found: Line, kind: str) -> Harmonics:
    cos, sin = (tuple(found.fit.of(f"{kind}_{turn}{k}") for k in HARMONICS) for turn in ("cos", "sin"))
    pairs = [(f"{kind}_cos{k}", f"{kind}_sin{k}") for k in HARMONICS]
    u = tuple(found.fit.sd(*pair) if pair[0] in found.angles and pair[1] in found.angles else 0.0 for pair in pairs)
    return Harmonics.model_validate({"cos": cos, "sin": sin, "u": u})


def cases(sheet: DataSheet) -> list[Case]:
    """A test case for each limit."""
    return [
        Case(
            f"{row.axis} {row.title}",
            sheet.device,
            "good" if row.kept else "failed",
            None,
            () if row.kept else (line_of(row),),
        )
        for row in sheet.rows
        if row.kept is not None
    ]


def line_of(row: SheetRow) -> str:
    """Why a limit is not kept."""
    from hil.characterising.figures import shown, shown_limit

    return f"{row.axis}: {row.title}: {shown(row)}, limit {shown_limit(row)}"
