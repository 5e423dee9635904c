"""Figures of a data sheet as columns of a campaign, and what cannot be one."""

import pytest

import hil
from hil.errors import InputError
from tests.campaigns.small import small

LONGER = {
    "scenario.rate": {"kind": "constant", "rate_rad_s": 1.0},
    "bench.loop.duration_s": 3.0,
    "bench.loop.settle_s": 1.0,
}


@pytest.mark.slow
def test_each_figure_is_a_column(tmp_path):
    asked = small(seeds=1, vary=[], fixed=LONGER, each={"figures": ["bias", "scale_factor_error"]})
    swept = hil.sweep(asked, out=tmp_path / "x", workers=1)
    (row,) = swept.table.to_pylist()
    assert row["outcome"] == "ran", row["reason"]
    assert abs(row["bias_rad_s"]) < 1.0  # the mean error of the rate over the scored window
    assert row["bias_rad_s"] != 0.0
    assert row["scale_factor_error_rel"] is None  # one rate tells no scale factor
    assert swept.table.schema.field("bias_rad_s").metadata[b"meaning"].startswith(b"bias, of a data sheet")


def test_a_figure_that_there_is_not(tmp_path):
    with pytest.raises(InputError, match="figures: drift: no figure of a data sheet; there are scale_factor_error"):
        hil.sweep(small(each={"figures": ["drift"]}), out=tmp_path / "x")
