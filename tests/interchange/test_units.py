"""Units of rates and levels: what is converted, what is kept, what is refused before it is judged."""

from pathlib import Path

import numpy as np
import pytest

from hil.bench import RateSensorBench, load_any_bench, load_bench
from hil.errors import InputError
from hil.importing.importer import import_file
from hil.importing.request import ImportRequest
from hil.records.capture import read_capture
from hil.replaying.replay import require_fit
from hil.tracing.demodulated import trace_ring_down
from hil.tracing.rate_sensor import trace_rate_sensor

INSTRUMENTS = Path(__file__).parents[3] / "shared" / "cases" / "instruments"
needs_cases = pytest.mark.skipif(not INSTRUMENTS.exists(), reason="the cases are not beside the checkout")


@needs_cases
@pytest.mark.slow
@pytest.mark.parametrize("unit", ["dB", "dBuV", "dBV"])
def test_a_level_with_a_reference_is_a_level(tmp_path: Path, unit: str) -> None:
    """The truth is linear damping; of the level itself 1.571 1/s by its slope, 20 log10(e) d/2 a second."""
    imported = import_file(
        ImportRequest(
            INSTRUMENTS / "1_level_dBuV.csv", tmp_path / "a.arrow", map_file=INSTRUMENTS / f"1_{unit}.map.toml"
        )
    )
    capture = imported.capture
    bench = load_bench(INSTRUMENTS / f"1_{unit}.bench.toml")
    require_fit(capture, bench, tmp_path / "a.arrow")
    slope = np.polyfit(capture.t_s, capture.sense_V[:, 0], 1)[0]
    assert -2.0 * slope / (20.0 * np.log10(np.e)) == pytest.approx(1.571, abs=0.005)
    _, found = trace_ring_down(tmp_path / "a.arrow", read_capture(tmp_path / "a.arrow"), bench, None)
    assert (found.verdict.value, found.effects) == ("adequate", ())
    assert "1.571" in " ".join(found.reasons)


@needs_cases
def test_a_level_is_of_no_waveform(tmp_path: Path) -> None:
    text = (INSTRUMENTS / "1_dBuV.bench.toml").read_text(encoding="utf-8")
    (tmp_path / "b.toml").write_text(text.replace('senses = "envelope"\n', ""), encoding="utf-8")
    with pytest.raises(InputError, match=r'unit: "dBuV" is a level, .* set senses = "envelope"'):
        load_bench(tmp_path / "b.toml")


@needs_cases
def test_a_rate_in_another_unit_than_declared_is_refused(tmp_path: Path) -> None:
    mapping = (INSTRUMENTS / "10.map.toml").read_text(encoding="utf-8")
    bench = load_any_bench(INSTRUMENTS / "10.bench.toml")
    assert isinstance(bench, RateSensorBench)
    import_file(
        ImportRequest(INSTRUMENTS / "10_gyro_mdps.csv", tmp_path / "a.arrow", map_file=INSTRUMENTS / "10.map.toml")
    )
    with pytest.raises(InputError, match=r"in mdps, but \[device\] unit = 'V'; set unit = \"mdps\""):
        trace_rate_sensor(tmp_path / "a.arrow", bench)
    (tmp_path / "m.toml").write_text(mapping.replace('unit = "mdps"', 'scale = 1e-3, unit = "dps"'), encoding="utf-8")
    capture = import_file(
        ImportRequest(INSTRUMENTS / "10_gyro_mdps.csv", tmp_path / "a.arrow", map_file=tmp_path / "m.toml")
    ).capture
    assert capture.sense_unit == "dps"
    slope = np.polyfit(capture.rate_rad_s, capture.sense_V[:, 0], 1)[0]
    assert slope == pytest.approx(bench.device.scale_V_s_per_rad, rel=0.02)


@pytest.mark.parametrize(
    ("unit", "one"),
    [("dps", np.pi / 180), ("mdps", np.pi / 180e3), ("mrad/s", 1e-3), ("deg/h", np.pi / 648e3), ("rpm", np.pi / 30)],
)
def test_rates_become_radians(tmp_path: Path, unit: str, one: float) -> None:
    (tmp_path / "a.csv").write_text("v,r\n1,3\n2,5\n3,7\n")
    text = 'hold = "zoh"\nsampling_rate_Hz = 1.0\n[columns]\nvx_V = { column = "v", unit = "V" }\n'
    (tmp_path / "m.toml").write_text(f'{text}rate_rad_s = {{ column = "r", unit = "{unit}" }}\n')
    capture = import_file(ImportRequest(tmp_path / "a.csv", tmp_path / "a.arrow", map_file=tmp_path / "m.toml")).capture
    np.testing.assert_allclose(capture.rate_rad_s, one * np.array([3.0, 5.0, 7.0]))


@pytest.mark.parametrize(
    ("entry", "told"),
    [
        ('rate_rad_s = { column = "r", unit = "LSB" }', "'LSB' says nothing by itself; give scale = what one is"),
        ('vx = { column = "v", unit = "dBx" }', "'dBx' is no level that is known; did you mean"),
    ],
)
def test_a_unit_that_says_nothing_is_refused(tmp_path: Path, entry: str, told: str) -> None:
    (tmp_path / "a.csv").write_text("v,r\n1,3\n2,5\n")
    sense = "" if entry.startswith("vx") else 'vx_V = { column = "v", unit = "V" }\n'
    (tmp_path / "m.toml").write_text(f'hold = "zoh"\nsampling_rate_Hz = 1.0\n[columns]\n{sense}{entry}\n')
    with pytest.raises(InputError, match=told):
        import_file(ImportRequest(tmp_path / "a.csv", tmp_path / "a.arrow", map_file=tmp_path / "m.toml"))


@pytest.mark.parametrize(
    ("name", "capture"),
    [("2997.txt", "2997"), ("a.csv.gz", "a"), ("b.mat", "b"), ("c.parquet", "c"), ("log.1", "log.1"), ("d", "d")],
)
def test_a_capture_is_named_after_its_file(name: str, capture: str) -> None:
    from hil.importing.request import named_after

    assert named_after(Path(name)) == Path(f"{capture}.arrow")
