"""`python -m benchmarks uncertainty`: its figures and its table, of devices by hand."""

from pathlib import Path
from typing import Any

import pytest

from benchmarks import uncertainty
from benchmarks.row import Row
from benchmarks.uncertainty import BEGIN, PLANTS, bench_of, followed, lowered, scenario_text, summary, table, with_table

PAGE = Path(__file__).parents[2] / "evaluation" / "results" / "verdicts.md"


def device(u: float, error: float, rows: dict[str, float]) -> dict[str, Any]:
    (source, contribution), *_ = sorted(rows.items(), key=lambda row: -row[1])
    return {
        "expanded_rad": u, "error_rad": error, "verdict": "good", "budget": rows,
        "row": {"source": source, "value": 1.0, "unit": "1", "sensitivity": "1", "contribution_rad": contribution},
    }  # fmt: skip


def values(rows: list[Row]) -> dict[str, float]:
    return {row.name: row.value for row in rows}


def test_figures_by_hand() -> None:
    found = [device(2.0, 1.0, {"clock": 1.0}), device(2.0, 3.0, {"clock": 0.5, "estimation": 0.8})]
    told = values(summary("two", found))
    assert told["two: errors within U (k = 2)"] == 0.5
    assert told["two: largest error over its U"] == 1.5
    assert told["two: U over the error, rms of their quotients"] == pytest.approx((2.0 / 2.5) ** 0.5)
    then = [device(1.0, 1.0, {"clock": 0.25}), device(2.0, 1.0, {"clock": 0.5, "estimation": 1.6})]
    told = values(lowered("two", found, then))
    assert told["two: a setting proposed"] == 2.0
    assert told["two: … lowers the largest row"] == 0.5  # 0.25 of it, and twice
    assert told["two: … to this share of it, median"] == pytest.approx(1.125)
    assert values(lowered("two", found, [None, None])) == {"two: a setting proposed": 0.0}


def test_the_table_is_written_into_its_page() -> None:
    found = [device(2e-3, 1e-3, {"clock": 1.0})]
    rows = [row for name in (*PLANTS, "all") for row in (*summary(name, found), *lowered(name, found, found))]
    text = table(rows)
    assert "| S-modern calibrated | 1 | 1 | 2 | 0.5 | 2 | 1 | 1 | 0 | 1 |" in text.splitlines()
    assert "| all | 1 | 1 | 2 | 0.5 |  |  | 1 | 0 | 1 |" in text.splitlines()
    page = PAGE.read_text(encoding="utf-8")
    written = with_table(page, text)
    assert text in written
    assert with_table(written, text) == written
    assert written.split(BEGIN)[0] == page.split(BEGIN)[0]


@pytest.mark.parametrize("name", list(PLANTS))
@pytest.mark.parametrize("source", ["drive gain", "drive misalignment", "undeclared effects", "what the model lacks"])
def test_what_is_proposed_is_followed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, name: str, source: str) -> None:
    """The second run has the setting in its bench file and the same device; or a constant known and drawn better."""
    made = []
    monkeypatch.setattr(uncertainty, "KEPT", tmp_path)
    monkeypatch.setattr(uncertainty, "one", lambda *_: device(1.0, 1.0, {source: 1.0}))
    monkeypatch.setattr(uncertainty, "_kept", lambda *given: made.append(given) or {})
    answer = followed(name, 7)
    bench = bench_of(PLANTS[name], 7)
    if source == "what the model lacks":
        assert (answer, made) == (None, [])
        return
    if answer is None:  # a pattern that no drive could turn faster
        assert source == "undeclared effects"
        return
    ((_, again, scenario),) = made
    assert again != bench
    if again.device != bench.device:
        (key,) = again.device.calibration.model_fields_set - bench.device.calibration.model_fields_set or {
            key
            for key in again.device.calibration.model_fields_set
            if getattr(again.device.calibration, key) != getattr(bench.device.calibration, key)
        }
        assert key in answer["proposed"]
        assert scenario != scenario_text(PLANTS[name], 7, bench)
    else:
        assert scenario == scenario_text(PLANTS[name], 7, bench)
