"""Records as laboratories have them, through a map: units of the sensor's own, bases that move, filters."""

import numpy as np
import pytest
from scipy.signal import butter, sosfreqz

from hil.errors import InputError
from hil.importing.importer import import_record
from hil.records.capture import read_capture

RATE, ROWS = 1000.0, 6000
OMEGA = 2 * np.pi * 17.0
TIME = np.arange(ROWS) / RATE


@pytest.fixture
def bring(tmp_path):
    """Import columns by name with the text of a map; gives the capture."""

    def bring(columns, map_text, header=None, delimiter=",", **options):
        source, mapping = tmp_path / "lab.csv", tmp_path / "lab.map.toml"
        table = np.column_stack(list(columns.values()))
        named = delimiter.join(columns) if header is None else header
        np.savetxt(source, table, delimiter=delimiter, header=named, comments="", fmt="%.12g")
        mapping.write_text(map_text, encoding="utf-8")
        import_record(source, tmp_path / "lab.arrow", map_file=mapping, **options)
        return read_capture(tmp_path / "lab.arrow")

    return bring


def mapped(columns: str, more: str = "", hold: str = "bandlimited") -> str:
    return f'hold = "{hold}"\nsampling_rate_Hz = {RATE}\n{more}\n[columns]\n{columns}\n'


@pytest.mark.moderate
def test_a_sensor_keeps_its_unit(bring):
    capture = bring({"e": TIME}, mapped('vx = { column = "e", unit = "µstrain", scale = 2.0, offset = 1.0 }'))
    assert capture.sense_unit == "µstrain"
    np.testing.assert_allclose(capture.sense_V[:, 0], 2 * TIME + 1, atol=1e-12)


@pytest.mark.moderate
@pytest.mark.parametrize(("order", "unit", "one"), [(0, "mm", 1e-3), (1, "mm/s", 1e-3), (2, "g", 9.80665)])
def test_a_base_pushes_by_less_than_its_acceleration(bring, order, unit, one):
    """x = X sin ωt: ẍ = −ω² x in closed form."""
    size = 2e-3
    given = size * OMEGA**order * np.sin(OMEGA * TIME + order * np.pi / 2)
    capture = bring(
        {"e": TIME, "b": given / one},
        mapped(f'vx = {{ column = "e", unit = "px" }}\nbase = {{ column = "b", unit = "{unit}" }}'),
    )
    assert capture.drive_unit == "mps2"
    expected = size * OMEGA**2 * np.sin(OMEGA * TIME)
    np.testing.assert_allclose(capture.drive[20:-20, 0], expected[20:-20], atol=1e-5 * size * OMEGA**2)
    np.testing.assert_allclose(capture.drive[:, 0], expected, atol=2e-3 * size * OMEGA**2)
    assert "less its acceleration" in capture.prepared[0]


@pytest.mark.moderate
def test_a_sensor_that_stands_beside_the_base_sees_it_too(bring):
    base, beside = 1e-3 * np.sin(OMEGA * TIME), 0.3 * np.cos(40.0 * TIME)
    seen = 1e3 * (beside + 1e-3 * OMEGA * np.cos(OMEGA * TIME))
    capture = bring(
        {"v": seen, "b": 1e3 * base},
        mapped('vx = { column = "v", unit = "mm/s", frame = "absolute" }\nbase = { column = "b", unit = "mm" }'),
    )
    np.testing.assert_allclose(capture.sense_V[20:-20, 0], 1e3 * beside[20:-20], atol=1e-3)


@pytest.mark.moderate
@pytest.mark.parametrize(("key", "kind", "passed"), [("low_Hz", "highpass", 200.0), ("high_Hz", "lowpass", 2.0)])
def test_a_filter_may_have_one_edge(bring, key, kind, passed):
    """The one tone by the filter's own response, the other gone."""
    tones = np.sin(2 * np.pi * 2.0 * TIME), np.sin(2 * np.pi * 200.0 * TIME)
    text = mapped('vx = { column = "e", unit = "px" }', hold="zoh") + f"[filter]\n{key} = 30.0\n"
    capture = bring({"e": tones[0] + tones[1]}, text)
    start = round(capture.t_s[0] * RATE)
    sections = butter(4, 30.0, kind, fs=RATE, output="sos")
    gain = abs(sosfreqz(sections, [passed], fs=RATE)[1][0]) ** 2
    expected = gain * np.sin(2 * np.pi * passed * TIME)[start : start + len(capture)]
    np.testing.assert_allclose(capture.sense_V[:, 0], expected, atol=1e-3)


@pytest.mark.moderate
def test_a_filter_has_no_delay_and_its_own_noise(bring):
    """Amplitude by the filter's own response, squared since it runs twice; the noise by counting."""
    inside, outside = np.sin(2 * np.pi * 20 * TIME), np.sin(2 * np.pi * 200 * TIME) + 3.0
    noise = np.random.default_rng(1).normal(size=ROWS)
    text = mapped('vx = { column = "e", unit = "px" }', hold="zoh") + "[filter]\nlow_Hz = 5\nhigh_Hz = 50\n"
    capture = bring({"e": inside + outside}, text)
    start = round(capture.t_s[0] * RATE)
    assert start > 0
    sections = butter(4, [5, 50], "bandpass", fs=RATE, output="sos")
    gain = abs(sosfreqz(sections, [20.0], fs=RATE)[1][0]) ** 2
    np.testing.assert_allclose(capture.sense_V[:, 0], gain * inside[start : start + len(capture)], atol=4e-3)
    rustle = bring({"e": noise}, text)
    assert rustle.noise_gain == pytest.approx(np.std(rustle.sense_V), rel=0.1)
    assert 0.25 < rustle.noise_gain < 0.35  # 45 of 500 Hz


def test_decimation_keeps_the_time_and_folds_nothing(bring):
    inside, folds = np.sin(2 * np.pi * 10 * TIME), np.sin(2 * np.pi * 90 * TIME)  # 90 Hz folds onto 10 Hz
    text = mapped('vx = { column = "e", unit = "mm" }', "[segments]\ntrain = [0, 4000]\ntest = [4000, 6000]", "zoh")
    capture = bring({"e": inside + folds}, text + "[filter]\ndecimate = 10\n")
    assert capture.tick_rate_Hz == pytest.approx(100.0)
    np.testing.assert_allclose(capture.sense_V[:, 0], np.sin(2 * np.pi * 10 * capture.t_s), atol=1e-3)
    first, edge = capture.segments["train"]
    assert first == 0
    assert capture.t_s[edge] == pytest.approx(4.0)
    assert capture.segments["test"] == (edge, len(capture))
    assert "every 10th sample kept, 100 Hz of 1000 Hz" in capture.prepared[0]


def test_covariates_travel_with_the_record(bring):
    capture = bring({"e": TIME}, mapped('vx = { column = "e", unit = "mm" }', "covariates = { load_kg = 0.5 }"))
    assert capture.covariates == {"load_kg": 0.5}


SENSED = 'vx = { column = "e", unit = "px" }'
BASED = SENSED + '\nbase = { column = "b", unit = "mm" }'


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (mapped(BASED, hold="zoh"), 'hold: a base moves between its samples; "bandlimited" or "foh"'),
        (mapped(BASED.replace("mm", "V")), r"\[columns.base\] unit: 'V' is no unit of a motion"),
        (mapped(BASED + '\nux_N = { column = "b", unit = "N" }'), "base beside a drive"),
        (mapped(SENSED.replace('"px"', '"px", frame = "absolute"')), "absolute beside no base"),
        (mapped(BASED.replace('"px"', '"px", frame = "absolute"')), "'px' is no unit of a motion"),
        (
            mapped(BASED.replace('"px"', '"mm", frame = "absolute"').replace('"b", unit = "mm"', '"b", unit = "g"')),
            "would have to be integrated to mm",
        ),
        (mapped(SENSED + '\nvx_V = { column = "b", unit = "V" }'), "both in volts and in a unit of its own"),
        (mapped(SENSED) + "[filter]\n", r"\[filter\] low_Hz: nothing to do"),
        (mapped(SENSED) + "[filter]\nlow_Hz = 50\nhigh_Hz = 5\n", "high_Hz: 5 Hz is not above low_Hz"),
        (mapped(SENSED) + "[filter]\nhigh_Hz = 600\n", "600 Hz is not below half the sampling rate of 1000 Hz"),
        (mapped(SENSED) + "[filter]\nhigh_Hz = 60\ndecimate = 10\n", "beyond the 40 Hz that decimate = 10 leaves"),
        (mapped(SENSED) + "[filter]\nlow_Hz = 0.01\nhigh_Hz = 5\n", "lasts .* the record 6 s; widen the band"),
        (
            mapped(SENSED + '\nux_N = { column = "b", unit = "N" }', hold="zoh") + "[filter]\nhigh_Hz = 50\n",
            "a staircase, which no filter leaves one",
        ),
        (mapped(SENSED.replace("px", "")), "unit: '' is no unit; give a word"),
        (mapped(SENSED) + "[fliter]\nhigh_Hz = 50\n", "unknown section; did you mean filter?"),
        (mapped(SENSED) + "[filter]\nhigh = 50\n", r"\[filter\] high: unknown key; did you mean high_Hz\?"),
    ],
)
def test_what_a_map_cannot_mean_is_told_with_the_key(bring, text, says, tmp_path):
    with pytest.raises(InputError, match=says) as caught:
        bring({"e": TIME, "b": TIME}, text)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "lab.arrow").exists()


@pytest.mark.parametrize(
    ("delimiter", "header", "says"),
    [
        (";", None, 'delimiter = ";"'),
        ("\t", None, r'delimiter = "\t"'),
        (",", "e1,b", "no column 'e' for vx; did you mean 'e1'?"),
        (",", "1.5,2.5", "its first line holds numbers; set header = false"),
    ],
)
def test_a_file_that_reads_otherwise_suggests_the_key(bring, delimiter, header, says):
    with pytest.raises(InputError) as caught:
        bring({"e": TIME, "b": TIME}, mapped(SENSED), header=header, delimiter=delimiter)
    assert says in str(caught.value)


def test_a_plain_file_with_another_delimiter_suggests_it(tmp_path):
    (tmp_path / "ride.csv").write_text("t_s;vx_V\n0;1\n1;2\n")
    with pytest.raises(InputError, match='one cell; give a --map with delimiter = ";"'):
        import_record(tmp_path / "ride.csv", tmp_path / "ride.arrow")
