"""`hil trace` of several records: files, maps, a bench file and the command as a user has them."""

import contextlib
import json
import subprocess
import sys

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hil import cli
from tests.cli.test_errors import refused

pytestmark = pytest.mark.slow

RATE, K, D, K3, NOISE_UM = 400.0, (2 * np.pi * 20.0) ** 2, 3.0, 6.0e8, 2.0

BENCH = f"""
[device]
name = "beam"
axes = 1
mass_kg = 1.0
stiffness_N_per_m = [{1.004 * K}]
damping_N_s_per_m = [3.5]
amplitude_m = 1e-3
sample_rate_Hz = {RATE}
[device.sense]
gain_V_per_m = 1e6
unit = "µm"
noise_V = {NOISE_UM}
offset_sd_V = {NOISE_UM}
[device.drive]
unit = "mps2"
full_scale = 100.0
[observer]
gain = "ekf"
[controller]
enabled = false
"""


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """A folder with four decays as captures, under loads of 0 to 0.3 kg, and their bench file."""
    folder = tmp_path_factory.mktemp("beam")
    (folder / "beam.bench.toml").write_text(BENCH, encoding="utf-8")
    rng = np.random.default_rng(3)
    t = np.arange(320) / RATE
    for number, start in enumerate((2e-3, 1e-3, 1.5e-3, 8e-4)):
        k = K - 180.0 * number
        solved = solve_ivp(
            lambda _, s, k: [s[1], -k * s[0] - D * s[1] - K3 * s[0] ** 3],
            (0.0, t[-1]), (start, 0.0), "DOP853", t, args=(k,), rtol=1e-10, atol=1e-14,
        )  # fmt: skip
        seen = 1e6 * solved.y[0] + rng.normal(0.0, NOISE_UM, t.size)
        np.savetxt(folder / f"load-{number}.csv", seen, header="laser", comments="")
        (folder / f"load-{number}.map.toml").write_text(
            f'hold = "zoh"\nsampling_rate_Hz = {RATE}\ncovariates = {{ load_kg = {0.1 * number} }}\n'
            '[columns]\nvx = { column = "laser", unit = "µm" }\n',
            encoding="utf-8",
        )
        with contextlib.chdir(folder):
            assert cli.execute(["import", f"load-{number}.csv", "--map", f"load-{number}.map.toml"]) == 0
    return folder


@pytest.fixture
def answer(bench, monkeypatch, capfd):
    """`answer("verb", …)` in the folder: exit code, standard output, standard error, without a process for it."""
    monkeypatch.chdir(bench)

    def call(*words):
        code = cli.execute(list(words))
        return code, *capfd.readouterr()

    return call


def hil(folder, *words):
    return subprocess.run(
        [sys.executable, "-m", "hil", *words], cwd=folder, capture_output=True, text=True, timeout=600, check=False
    )


RECORDS = [f"load-{number}.arrow" for number in range(4)]


@pytest.mark.long
def test_four_loads_in_one_trace(bench):
    done = hil(bench, "trace", *RECORDS, "--bench", "beam.bench.toml", "--covariate", "load_kg", "--hold-out", "load-2")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "kxx depends on load_kg" in done.stdout
    assert "load-2, load_kg = 0.2, which was held out" in done.stdout
    assert "µm" in done.stdout
    (folder,) = (bench / "runs").iterdir()
    diagnosis = json.loads((folder / "diagnosis.json").read_text())
    assert diagnosis["sense_unit"] == "µm"
    (found,) = diagnosis["dependences"]
    low, high = found["per_unit"]["ci95"]
    assert low - (high - low) < -1800.0 < high + (high - low)
    page = (folder / "report.html").read_text()
    assert "What depends on the covariate" in page
    assert "µm" in page


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ([*RECORDS, "--covariate", "laod"], "load-0.arrow: no covariate laod; it has: load_kg"),
        ([*RECORDS, "--hold-out", "load-9"], "--hold-out: no record load-9; there are: load-0, load-1"),
        ([RECORDS[0], RECORDS[0]], "load-0: named twice"),
        ([RECORDS[0], "--covariate", "load_kg"], "--covariate and --hold-out belong to several records"),
        ([*RECORDS, "--fraction", "0.5"], "several records: they are held out whole"),
        ([*RECORDS, "--add", "x.bench.toml"], "--add: of several records no bench file is written"),
        ([*RECORDS[:2]], "1 records to fit and 1 to judge"),
    ],
)
def test_what_cannot_be_is_told_in_a_line(answer, words, says):
    assert says in refused(answer("trace", *words, "--bench", "beam.bench.toml"))


def test_a_record_in_another_unit_is_refused(bench, answer):
    text = BENCH.replace('unit = "µm"', 'unit = "px"')
    (bench / "px.bench.toml").write_text(text, encoding="utf-8")
    line = refused(answer("trace", RECORDS[0], "--bench", "px.bench.toml"))
    assert "sensed in µm, but [device.sense] unit = 'px'" in line
