"""A data sheet that records gave, as an object."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from hil.library.given import several
from hil.library.loading import Run, folder_of
from hil.progress import Watcher
from hil.records.data_sheet import DataSheet, SheetRow

if TYPE_CHECKING:
    from hil.characterising.options import LocalCharacteriseOptions

SheetRecord = Run | Path | str


class Sheet:
    """The figures of a device, and the folder where they are kept.

    Attributes:
        sheet: all of it, as in characteristics.json.
        calibration: the file in which what depends on the angle was kept, None where that was not asked for.
    """

    def __init__(self, folder: Path, sheet: DataSheet, calibration: Path | None = None) -> None:
        self._folder, self.sheet, self.calibration = folder, sheet, calibration

    @property
    def path(self) -> Path:
        """Folder with characteristics.json and report.html."""
        return self._folder

    @property
    def verdict(self) -> str:
        """`good`, or `failed` where a limit is not kept."""
        return self.sheet.verdict

    def __getitem__(self, figure: str) -> SheetRow:
        """The row of a figure: `sheet["angle_random_walk"].sheet_value`.  Raises KeyError."""
        return self.sheet.of(figure)

    def __repr__(self) -> str:
        told = sum(row.value is not None for row in self.sheet.rows)
        return f"<Sheet of {self.sheet.device}: {told} figures, {self.verdict}>"


def is_sensor(record: object) -> bool:
    """Whether it is the link of a sensor that is recorded first, and no file of that name."""
    return isinstance(record, str) and ":" in record and not Path(record).exists()


def recorded_at(
    records: "SheetRecord | Sequence[SheetRecord]", out: Path, options: "LocalCharacteriseOptions", progress: Watcher
) -> list[Path]:
    """The runs or captures that are given; a sensor by its link is recorded first, below `out`."""
    from hil.report.sensor import write_report
    from hil.sensors.record import record as record_port
    from hil.sensors.request import request_of as recording

    places: list[Path] = []
    for one in several(records):
        if is_sensor(one):
            request = recording(str(one), {"duration_s": options.get("duration_s") or 60.0})
            places.append(record_port(request, out, progress=progress, report=write_report))
        else:
            place = folder_of("record", one, "a Run, or the path of a run folder or a capture")
            places.append(place)
    return places
