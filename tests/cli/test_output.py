"""Tables on a terminal: nothing is lost where they have to be narrow."""

import pytest

from hil.bench.data_sheet import FIGURES
from hil.cli.output import Output
from hil.records.methods import MethodRow, Methods
from hil.report.methods import SHORT, sheet_rows, short_cells

ROW = MethodRow(
    name="(a) rate by modulating functions, integrated", kind="observer", record="this", angle_rad=1.0,
    angle_error_rms_rad=1.2345, rate_error_rms_rad_s=12.345, stiffness_error=0.0123, damping_error=0.123,
    settled_s=123.4, cost_us=12.3, sheet={figure.name: (-1.234e-3, -2.345e-3, 0.123e-3) for figure in FIGURES},
)  # fmt: skip


@pytest.mark.parametrize("columns", [60, 100, 200])
def test_a_table_fits_and_has_every_cell(columns: int, capsys: pytest.CaptureFixture[str]) -> None:
    found = Methods(record="r", bench="b", seconds=1.0, window_s=(0.0, 1.0), reference="truth", rows=(ROW,), remarks=())
    head, rows = sheet_rows(found, short=True)
    for heading, cells in ((SHORT, [short_cells(ROW)]), (head, rows)):
        Output().table(heading, cells, right=range(1, len(heading)), fit=columns)
        printed = capsys.readouterr().out
        assert max(map(len, printed.splitlines())) <= columns
        assert all(word in printed.split() for cell in cells[0] for word in cell.split())


def test_the_first_column_is_broken_only_where_the_others_need_the_room(capsys: pytest.CaptureFixture[str]) -> None:
    name = ROW.name
    Output().table(["method", "mrad"], [[name, "18 000"]], right=(1,), fit=100)
    assert name in capsys.readouterr().out
    Output().table(["method", "mrad"], [[name, "18 000"]], right=(1,), fit=len(name) + 7)
    assert name not in capsys.readouterr().out


def test_an_observer_without_an_uncertainty_says_so() -> None:
    assert short_cells(ROW)[2] == "not given"
    assert short_cells(ROW.model_copy(update={"kind": "prior art"}))[2] == ""
