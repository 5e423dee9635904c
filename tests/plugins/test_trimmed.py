"""An observer of one's own is told of trim voltages as the bench's own is."""

import sys
from pathlib import Path

import numpy as np
import pytest

import hil
from hil.bench import load_bench
from hil.bench.examples import find
from hil.errors import InputError
from hil.plugins.finding import write_template
from hil.records.runfolder import RunFolder
from hil.running.process.worker import Order, work
from hil.running.request import RunRequest
from tests.plugins.compiled import library
from tests.plugins.running import HERE

pytestmark = [pytest.mark.usefixtures("no_report"), pytest.mark.slow]

BENCH = load_bench(find("bench", "s-trim"))
SECONDS, RATE_HZ = 5.0, 4000


def run(folder: Path, observer: str | None) -> tuple[str, RunFolder]:
    """S-trim in lockstep within this process, nothing driven but springs and losses: why it ended, and its record."""
    bench = BENCH.with_(
        loop={"clock": "lockstep", "duration_s": SECONDS, "settle_s": 0.5 * SECONDS},
        observer={"plugin": observer},
        controller={"virtual_rotation_rad_s": 0.0, "dither_mps2": 0.0},
    )
    folder.mkdir()
    order = Order(RunRequest(bench, f"inproc:{find('scenario', 's-trim')}"), str(folder))
    outcome = work(order, lambda **_: None, own_process=False)
    return outcome["stopped"], RunFolder(folder)


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    stopped, folder = run(tmp_path_factory.mktemp("trimmed") / "run", f"{HERE / 'own.py'}:Trimmed")
    assert stopped == ""
    return folder


@pytest.mark.moderate
def test_the_bench_s_own_control_nulls_by_its_springs(told: RunFolder) -> None:
    """The bench's own estimator, as a plug-in that has its voltages from the interface alone."""
    last = told.estimates.part(len(told.estimates) - 1, len(told.estimates))
    k = np.array([last.columns[f"{name}_per_s2"][0] for name in ("kxx", "kyy", "kxy")])
    left = k / BENCH.target_stiffness_per_s2 - [1.0, 1.0, 0.0]
    assert np.all(np.abs(left) < 1e-4)
    assert told.trims.volts[-1].max() > 3.0


@pytest.mark.moderate
def test_it_hears_each_voltage_as_it_settles(told: RunFolder) -> None:
    """In closed form, from what the record says was put out: a step settles with the time constant of the output."""
    heard = sys.modules["_plugin_own"].Trimmed.HEARD
    trims, first = told.trims, int(told.capture.ends[0])
    settling_s = np.array([one["settling_s"] for one in trims.outputs])
    softening = np.array(BENCH.trim.softening_N_per_m_per_V2) / BENCH.device.mass_kg
    assert heard[0][:2] == (0, (0.0,) * 4)
    assert len(heard) > 1000
    for sample, volts, softened in heard[1::50]:
        middle = first + sample - 0.5  # of the interval that ends there
        known = [row for row in range(len(trims)) if trims.tick[row] <= first + sample]
        now = np.zeros(4)
        for row, then in zip(known, [*known[1:], None], strict=True):
            until = middle if then is None else trims.columns["acted_tick"][then]
            since_s = (until - trims.columns["acted_tick"][row]) / RATE_HZ
            now = trims.volts[row] + (now - trims.volts[row]) * np.exp(-since_s / settling_s)
        np.testing.assert_allclose(volts, now, atol=2e-4)
        np.testing.assert_allclose(softened, np.square(volts) @ softening, rtol=1e-12)


def test_the_template_in_c_and_python_follow_a_record_s_voltages(told: RunFolder, tmp_path: Path) -> None:
    """The motion stays along x: what the springs of y do is seen little, and known by the voltages."""
    (deaf, *_), _ = write_template("observer", tmp_path / "deaf.py")
    deaf.write_text(deaf.read_text().replace("self.springs[i] += self.softened[i] - now", "pass"))
    (heard, *_), _ = write_template("observer", tmp_path / "heard.py")
    (compiled, *_), _ = write_template("observer", tmp_path / "heard.c")
    ends = []
    for number, plugin in enumerate((f"{heard}:MyObserver", library(compiled), f"{deaf}:MyObserver")):
        again = hil.replay(told.capture_path, BENCH.with_(observer={"plugin": plugin}), out=tmp_path / str(number))
        states = RunFolder(again.path).estimates
        ends.append([states.columns[f"{name}_per_s2"][-1] for name in ("kxx", "kyy", "kxy")])
    np.testing.assert_allclose(ends[0], ends[1], rtol=1e-9)
    assert ends[0][0] == pytest.approx(BENCH.target_stiffness_per_s2, abs=200.0)
    assert abs(ends[2][1] - ends[0][1]) > 5e3


def test_one_that_cannot_be_told_is_refused_before_the_board_is_armed(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"it cannot be told of their voltages; give it a method trimmed"):
        run(tmp_path / "run", f"{HERE / 'own.py'}:Own")
    (old, *_), _ = write_template("observer", tmp_path / "old.c")
    old.write_text(old.read_text().replace("void gyro_plugin_trimmed", "void unknown_then"))
    plugin = library(old)
    with pytest.raises(InputError, match="a function gyro_plugin_trimmed"):
        run(tmp_path / "compiled", plugin)
