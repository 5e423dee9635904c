"""A table and a chamber in a campaign, simulated by PyVISA-sim: steps, soak, actual values, and the way to rest."""

from pathlib import Path
from typing import Any

import pytest

import hil
from hil.bench import examples
from hil.errors import InputError
from hil.records.instruments import read_instruments
from hil.sweeping.campaign import Campaign
from hil.sweeping.instrument import Opened, Table

SIMULATED = """\
spec: "1.0"
devices:
  table:
    eom: {{ASRL INSTR: {{q: "\\n", r: "\\n"}}}}
    properties:
      rate:
        default: 0.0
        getter: {{q: "RATE?", r: "RATE {{:.4f}} DPS"}}
        setter: {{q: "RATE {{:.4f}}"}}
        specs: {{type: float}}
  chamber:
    eom: {{TCPIP INSTR: {{q: "\\n", r: "\\n"}}}}
    properties:
      temperature:
        default: 23.0
        getter: {{q: ":MEAS:TEMP?", r: "{{:.2f}}"}}
        setter: {{q: ":SOUR:TEMP {{:.2f}}"}}
        specs: {{type: float}}
  stuck:
    eom: {{ASRL INSTR: {{q: "\\n", r: "\\n"}}}}
    dialogues:
      - {{q: "RATE?", r: "{stuck}"}}
    properties:
      rate:
        default: 0.0
        setter: {{q: "RATE {{:.4f}}"}}
        specs: {{type: float}}
resources:
  ASRL1::INSTR: {{device: table}}
  ASRL2::INSTR: {{device: stuck}}
  TCPIP::chamber::INSTR: {{device: chamber}}
"""


@pytest.fixture
def backend(tmp_path: Path) -> str:
    (tmp_path / "bench.yaml").write_text(SIMULATED.format(stuck="88.2"))
    return f"{tmp_path / 'bench.yaml'}@sim"


@pytest.fixture
def commands(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What the instruments are told, in order."""
    told: list[str] = []
    write = Opened._write

    def written(self: Opened, command: str) -> None:
        told.append(f"{self.name}: {command}")
        write(self, command)

    monkeypatch.setattr(Opened, "_write", written)
    return told


def table(backend: str, **changes: Any) -> dict[str, Any]:
    usual = {"resource": "ASRL1::INSTR", "backend": backend, "set": "RATE {target:.4f}", "read": "RATE?"}
    return usual | {"tolerance": 0.1, "dwell_s": 0.3, "timeout_s": 2.0, "limit": 200.0} | changes


def campaign(backend: str, **changes: Any) -> dict[str, Any]:
    chamber = {"resource": "TCPIP::chamber::INSTR", "set": ":SOUR:TEMP {target:.2f}", "read": ":MEAS:TEMP?"}
    scenario = examples.find("scenario", "s-slow")
    return {
        "name": "steps",
        "bench": "s-slow",
        "fixed": {
            "bench.link.url": f"inproc:{scenario}",
            "bench.loop.clock": "lockstep",
            "bench.loop.duration_s": 1.0,
            "bench.loop.settle_s": 0.3,
        },
        "vary": [
            {"key": "chamber.temperature_C", "values": [-20.0, 60.0]},
            {"key": "table.rate_dps", "values": [90.0, -45.0]},
        ],
        "table": table(backend),
        "chamber": {**chamber, "backend": backend, "tolerance": 0.5, "limit": 100.0},
    } | changes


def test_each_run_has_its_step_and_the_table_rests_at_the_end(
    tmp_path: Path, backend: str, commands: list[str], no_report: None
) -> None:
    found = hil.sweep(campaign(backend), out=tmp_path / "out")
    rows = found.table.to_pylist()
    assert [row["outcome"] for row in rows] == ["ran"] * 4, [row["reason"] for row in rows]
    assert [(row["temperature_C"], row["rate_dps"]) for row in rows] == [(-20, 90), (-20, -45), (60, 90), (60, -45)]
    assert [row["chamber_C"] for row in rows] == [-20.0, -20.0, 60.0, 60.0]
    assert [row["table_rate_rad_s"] for row in rows] == pytest.approx([1.5708, -0.7854] * 2, rel=1e-4)
    # The board turns by its own profile, 90 °/s at first, whatever the simulated table does.
    assert rows[0]["rate_less_table_rad_s"] == pytest.approx(0.0, abs=0.05)
    assert rows[1]["rate_less_table_rad_s"] == pytest.approx(0.75 * 3.14159, abs=0.05)
    assert commands[:2] == ["table: RATE 90.0000", "chamber: :SOUR:TEMP -20.00"]
    assert commands[-1] == "table: RATE 0.0000"
    (first, *_) = sorted((tmp_path / "out" / "runs").iterdir())
    actual = read_instruments(first)
    assert set(actual) == {"host_ns", "table", "chamber"}
    assert actual["table"].tolist() == [90.0] * len(actual["host_ns"])


def test_a_table_that_does_not_get_there_is_said_and_told_to_rest(
    tmp_path: Path, backend: str, commands: list[str], capfd: pytest.CaptureFixture[str]
) -> None:
    stuck = table(backend, resource="ASRL2::INSTR", timeout_s=0.6)
    vary = [{"key": "table.rate_dps", "values": [90.0]}]
    given = campaign(backend, table=stuck, vary=vary)
    del given["chamber"]
    (row,) = hil.sweep(given, out=tmp_path / "out").table.to_pylist()
    assert row["outcome"] == "refused"
    assert row["reason"] == "[table] timeout_s: 88.2 after 0.6 s, expected 90 ± 0.1 for 0.3 s"
    assert commands[-1] == "table: RATE 0.0000"
    assert "hil: UNSAFE: the table may still move" in capfd.readouterr().err


def test_an_interruption_brings_the_table_to_rest(
    tmp_path: Path, backend: str, commands: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("hil.sweeping.with_instruments.run", interrupted)
    with pytest.raises(KeyboardInterrupt):
        hil.sweep(campaign(backend), out=tmp_path / "out")
    assert commands[-1] == "table: RATE 0.0000"


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"scenario": "s-slow"}, "an emulated board feels no table"),
        ({"vary": []}, r"\[table\]: no targets; give \[\[vary\]\] key = \"table.rate_dps\""),
        ({"each": {"scan": True}}, "belongs to emulated boards"),
        ({"vary": [{"key": "table.rate_dps", "values": [900.0]}]}, r"beyond \[table\] limit = 200"),
        ({"table": {"resource": "ASRL1::INSTR"}}, "missing"),
    ],
)
def test_a_campaign_that_cannot_be_meant_is_refused_in_one_line(
    tmp_path: Path, backend: str, changes: dict[str, Any], told: str
) -> None:
    with pytest.raises(InputError, match=told) as raised:
        hil.sweep(campaign(backend) | changes, out=tmp_path / "out")
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"set": "RATE 5"}, "expected a command with {target}"),
        ({"set": "RATE {rate}"}, "expected a command with {target}"),
        ({"timeout_s": 0.1}, "is over before dwell_s"),
        ({"tolerance": 0.0}, "tolerance"),
    ],
)
def test_a_declaration_that_is_wrong_is_refused(backend: str, changes: dict[str, Any], told: str) -> None:
    with pytest.raises(ValueError, match=told):
        Table.model_validate(table(backend, **changes))


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"resource": "ASRL9::INSTR"}, r"\[table\] (resource|read): ASRL9::INSTR"),
        ({"backend": "nowhere.yaml@sim"}, r"\[table\] (resource|read): ASRL1::INSTR"),
        ({"read": "SPEED?"}, r"\[table\] read"),
    ],
)
def test_an_instrument_that_does_not_answer_is_one_line(backend: str, changes: dict[str, Any], told: str) -> None:
    with pytest.raises(InputError, match=told) as raised:
        Opened("table", Table.model_validate(table(backend) | changes))
    assert "\n" not in str(raised.value)


def test_a_board_that_is_real_needs_consent(tmp_path: Path, backend: str) -> None:
    given = campaign(backend)
    given["fixed"]["bench.link.url"] = "serial:/dev/nowhere"
    with pytest.raises(InputError, match="arm=True"):
        hil.sweep(given, out=tmp_path / "out")
    assert Campaign.model_validate(campaign(backend)).targets == {
        "table": "table.rate_dps",
        "chamber": "chamber.temperature_C",
    }
