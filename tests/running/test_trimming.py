"""Trim electrodes in a run: nulled from rest, replayed, stopped at zero, and boards that misbehave."""

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import lsq_linear

import hil
from device_emulator.board import Board
from device_emulator.device import Device
from device_emulator.registers import Refused, Registers
from hil import plugins as templates
from hil.bench import Bench, load_bench
from hil.bench.examples import find
from hil.errors import InputError
from hil.records.result import load_result
from hil.records.runfolder import RunFolder
from hil.running.loop.trimming import _NEARER, nulling
from hil.running.process.worker import Order, work
from hil.running.request import RunRequest
from hil.wire.messages import NackReason, RegisterValue
from hil.wire.spec import SPEC

BENCH = load_bench(find("bench", "s-trim"))
SCENARIO = find("scenario", "s-trim")
TRIMS = {SPEC.registers[f"TRIM_{k}"].id for k in range(8)}
UNMODULATED = {"virtual_rotation_rad_s": 0.0, "dither_mps2": 0.0}
"""Nothing is driven but the springs and the losses."""


def run(folder: Path, scenario: Path = SCENARIO, seconds: float = 8.0, **changes) -> tuple[dict, RunFolder]:
    """A run in lockstep within this process: what happened, and its folder."""
    bench = BENCH.with_(**{"loop": {"clock": "lockstep", "duration_s": seconds, "settle_s": 0.5 * seconds}, **changes})
    folder.mkdir(exist_ok=True)
    outcome = work(Order(RunRequest(bench, f"inproc:{scenario}"), str(folder)), lambda **_: None, own_process=False)
    return outcome, RunFolder(folder)


def changed(tmp_path: Path, old: str, new: str) -> Path:
    """The scenario with some text changed."""
    text = SCENARIO.read_text()
    assert old in text
    place = tmp_path / "changed.scenario.toml"
    place.write_text(text.replace(old, new))
    return place


def drive_mps2(folder: RunFolder, begin: int) -> float:
    """Rms of the drive from sample `begin` on, for a second."""
    rows = folder.capture.between(begin, begin + 4000)
    codes = np.column_stack([rows.columns["ux_code"], rows.columns["uy_code"]])
    return float(np.sqrt(np.mean(np.sum((codes * 10.0 / 2**15) ** 2, axis=1))))


def springs(folder: RunFolder) -> np.ndarray:
    """What is left of them at the end, in units of the target: xx - k, yy - k, xy."""
    last = folder.estimates.part(len(folder.estimates) - 1, len(folder.estimates))
    k = np.array([last.columns[f"{name}_per_s2"][0] for name in ("kxx", "kyy", "kxy")])
    return k / BENCH.target_stiffness_per_s2 - [1.0, 1.0, 0.0]


@pytest.fixture(scope="module")
def nulled(tmp_path_factory):
    return run(tmp_path_factory.mktemp("nulled"), controller=UNMODULATED)


@pytest.mark.moderate
def test_a_split_of_two_per_cent_is_nulled_from_rest(nulled, tmp_path):
    """The promise: the drive that is needed falls by more than 20 times beside that of the same gyro untrimmed."""
    outcome, folder = nulled
    assert outcome["stopped"] == ""
    assert outcome["safety"]["confirmed"] is True
    left = springs(folder)
    assert abs(left[0] - left[1]) < 1e-4
    assert np.all(np.abs(left) < 1e-4)
    _, bare = run(tmp_path / "bare", controller=UNMODULATED, trim={"control": False})
    assert abs(springs(bare)[0] - springs(bare)[1]) == pytest.approx(0.0203, abs=1e-3)
    assert drive_mps2(bare, 28000) > 20.0 * drive_mps2(folder, 28000)


@pytest.mark.slow
@pytest.mark.parametrize("closed", ["gain mode", "a controller plug-in"])
def test_it_is_nulled_whoever_drives_while_the_bench_observes(tmp_path, closed):
    loop = {"clock": "lockstep", "duration_s": 8.0, "settle_s": 4.0}
    changes = {"loop": loop, "controller": UNMODULATED}
    if closed == "gain mode":
        changes = {"loop": loop | {"mode": "gain", "block": 40}, "link": {"watchdog_s": 0.2}, "controller": UNMODULATED}
    else:
        template = Path(templates.__file__).parent / "templates" / "controller.py"
        changes["controller"] = UNMODULATED | {"plugin": f"{template}:MyController"}
    drives = []
    for control in (False, True):
        place = tmp_path / str(control)
        place.mkdir()
        bench = BENCH.with_(**changes, trim={"control": control})
        order = Order(RunRequest(bench, f"inproc:{SCENARIO}"), str(place))
        outcome = work(order, lambda **_: None, own_process=False)
        assert outcome["stopped"] == ""
        assert outcome["safety"]["confirmed"] is True
        drives.append(drive_mps2(RunFolder(place), 28000))
    assert np.all(np.abs(springs(RunFolder(place))) < 1e-4)
    assert drives[0] > 20.0 * drives[1]


@pytest.mark.slow
@pytest.mark.parametrize(("mode", "seconds"), [("classic_whole_angle", 14.0), ("mode_reversal", 26.0)])
def test_the_classic_loops_are_trimmed_by_the_springs_that_they_follow(mode, seconds, tmp_path):
    """The rate turns the pattern, or the exchange of axes the line, without a rate: its force would be driven too."""
    drives, scenario = [], SCENARIO
    if mode == "mode_reversal":
        scenario = changed(tmp_path, "rate_rad_s = 0.5", "rate_rad_s = 0.0")
    law = UNMODULATED | {"mode": mode}
    for control in (False, True):
        outcome, folder = run(tmp_path / str(control), scenario, seconds, controller=law, trim={"control": control})
        assert outcome["stopped"] == ""
        assert outcome["safety"]["confirmed"] is True
        drives.append(drive_mps2(folder, 4000 * int(seconds - 2)))
        if not control:
            true = np.array([1594.93, 1563.35, 7.896]) / BENCH.device.mass_kg
            last = folder.estimates.part(len(folder.estimates) - 800, len(folder.estimates))
            names = [f"{name}_per_s2" for name in ("kxx", "kyy", "kxy")]
            off, sd = (np.column_stack([last.columns[f"{sd}{name}"] for name in names]) for sd in ("", "sd_"))
            assert np.mean(np.abs(off - true) < 2.0 * sd) > 0.9
            assert np.all(sd < 1e-3 * BENCH.target_stiffness_per_s2)
    assert np.all(np.abs(springs(folder)) < 2e-4)
    assert drives[0] > 20.0 * drives[1]


@pytest.mark.moderate
def test_the_voltages_are_ramped_bounded_and_recorded(nulled):
    _, folder = nulled
    trims = folder.trims
    assert [one["name"] for one in trims.outputs] == ["x", "y", "q+", "q-"]
    assert not np.any(trims.volts[0])
    assert np.all(np.abs(np.diff(trims.volts, axis=0)) <= 10.0 * 0.05 + 1e-3)
    assert np.all(trims.volts >= 0.0)
    assert np.all(np.diff(trims.tick) > 0)
    assert np.all(trims.columns["acted_tick"][1:] < trims.tick[1:])


@pytest.mark.moderate
def test_the_limit_of_the_bench_file_bounds_them(tmp_path):
    outcome, folder = run(tmp_path / "run", trim={"limit_V": 3.0})
    assert outcome["stopped"] == ""
    assert folder.trims.volts.max() == pytest.approx(3.0, abs=2e-3)


@pytest.mark.moderate
def test_a_replay_says_what_the_run_said(nulled, tmp_path):
    _, folder = nulled
    bench = Bench.model_validate(BENCH.model_dump()).with_(loop={"settle_s": 4.0}, controller=UNMODULATED)
    again = hil.replay(folder.capture_path, bench, out=tmp_path).path
    ours, theirs = folder.estimates, RunFolder(again).estimates
    for name in ("kxx_per_s2", "kyy_per_s2", "kxy_per_s2", "rate_rad_s"):
        np.testing.assert_allclose(theirs.columns[name], ours.columns[name], rtol=1e-9, atol=1e-9)
    assert RunFolder(again).trims.volts.tolist() == folder.trims.volts.tolist()
    scan = load_result(again / "result.json").scan
    assert scan is not None
    assert scan.complete is not False


@pytest.mark.moderate
def test_a_supply_that_is_lost_on_the_way_ends_in_safe_at_zero(tmp_path, monkeypatch):
    boards = []
    monkeypatch.setattr(Board, "close", lambda self, close=Board.close: (boards.append(self), close(self)))
    lost = changed(tmp_path, "[rate]", "[[faults.brown_out]]\nstart_s = 3.0\nduration_s = 0.05\n\n[rate]")
    outcome, folder = run(tmp_path / "run", lost)
    assert folder.trims.volts[-1].max() > 3.0
    assert "check the board's supply" in outcome["stopped"]
    assert outcome["safety"]["confirmed"] is True
    (board,) = boards
    assert all(board.registers.read(number) == 0 for number in board.registers.trims)
    assert not np.any(board._device._records[3]["trim_target_V"])


@pytest.mark.moderate
def test_without_control_nothing_is_put_out(tmp_path, monkeypatch):
    put = []
    monkeypatch.setattr(Device, "trim", lambda self, k, volts: put.append(volts))
    outcome, _ = run(tmp_path / "run", seconds=2.0, trim={"control": False})
    assert outcome["stopped"] == ""
    assert set(put) == {0.0}


def _answering(value):
    def write(self, request, write=Board._write):
        if request.register not in TRIMS or not request.value:
            return write(self, request)
        return value(self, request, write)

    return write


def _refuse(*_):
    raise Refused(NackReason.OUT_OF_RANGE)


MISBEHAVING = {
    "refuses": (_answering(_refuse), "trim output 'x', TRIM_0, was refused"),
    "answers by another code": (
        _answering(lambda self, request, write: [RegisterValue(request.register, request.value + 7)]),
        "reads",
    ),
    "does not answer": (_answering(lambda *_: []), "did not answer"),
}


@pytest.mark.moderate
@pytest.mark.parametrize("kind", MISBEHAVING)
def test_a_board_that_does_not_put_out_what_it_is_told_ends_the_run(kind, tmp_path, monkeypatch):
    write, told = MISBEHAVING[kind]
    monkeypatch.setattr(Board, "_write", write)
    outcome, _ = run(tmp_path / "run", link={"timeout_s": 0.2})
    assert told in outcome["stopped"]
    assert outcome["stopped"].endswith("check the output and the board's firmware")
    assert outcome["safety"]["confirmed"] is True


@pytest.mark.moderate
@pytest.mark.parametrize("softening", ["[0.0, 0.0, 0.0]", "[-0.63, 0.0, 0.0]"])
def test_an_electrode_that_never_settles_or_stiffens_ends_the_run(softening, tmp_path):
    """Not connected, or of the other sign: the voltage would run to its end for nothing."""
    dead = changed(tmp_path, "softening_N_per_m_per_V2 = [0.63, 0.02, 0.0]", f"softening_N_per_m_per_V2 = {softening}")
    outcome, _ = run(tmp_path / "run", dead, 12.0)
    assert "trim output 'x', TRIM_0, is at" in outcome["stopped"]
    assert "kxx has not moved" in outcome["stopped"]
    assert outcome["safety"]["confirmed"] is True


@pytest.mark.moderate
def test_a_board_that_keeps_a_voltage_in_safe_is_not_confirmed(tmp_path, monkeypatch):
    """STATUS says SAFE; the register does not."""
    monkeypatch.setattr(Registers, "zero_trims", lambda self: self._values.update(dict.fromkeys(self.trims, 5)))
    monkeypatch.setattr("hil.running.process.worker.zeroed", None, raising=False)
    monkeypatch.setattr("hil.running.safety.trim_outputs.zeroed", lambda _, outs, __: {o.register: 0.0 for o in outs})
    outcome, _ = run(tmp_path / "run", seconds=1.0)
    assert outcome["safety"]["confirmed"] is False
    assert "TRIM_0 is at code 5, its electrode is charged" in outcome["safety"]["words"]


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"outputs": 9}, "outputs is 9"),
        ({"lowest": 1}, "no range around 0"),
        ({"scale_V": float("nan")}, "scale_V is nan"),
        ({"scale_V": 1e30}, "no board has that"),
        ({"settling_s": -1.0}, "settling_s is -1"),
        ({"settling_s": float("inf")}, "settling_s is inf"),
        ({"name": ""}, "its name is empty"),
    ],
)
def test_an_output_that_no_board_has_is_refused_before_it_is_armed(wrong, told, tmp_path, monkeypatch):
    true = Board._trim
    monkeypatch.setattr(Board, "_trim", lambda self, request: [true(self, request)[0]._replace(**wrong)])
    with pytest.raises(Exception, match=f"TRIM_OUTPUT 0: .*{told}.*correct the firmware"):
        run(tmp_path / "run")


def test_a_bench_file_and_a_board_have_to_agree(tmp_path):
    with pytest.raises(InputError, match="has no output 'z'; it has x, y, q\\+, q-"):
        run(tmp_path / "a", trim={"electrodes": ("z",), "softening_N_per_m_per_V2": ((1.0, 0.0, 0.0),)})
    with pytest.raises(InputError, match=r"no trim outputs; take \[trim\] electrodes out"):
        run(tmp_path / "b", find("scenario", "s-slow"))


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"trim": {"softening_N_per_m_per_V2": ((1.0, 0.0, 0.0),)}}, "a row for each of 4"),
        ({"trim": {"electrodes": ("x", "x", "y", "q+")}}, "twice"),
        ({"trim": {"softening_u": (0.1, 0.1)}}, "one per electrode"),
        ({"controller": {"enabled": False}}, "nulls what a closed loop shows"),
        ({"controller": {"mode": "force_to_rebalance"}}, 'force_to_rebalance" holds the motion on one line'),
        ({"loop": {"mode": "board", "estimate_every": 250}}, "a board's own estimator does not get"),
    ],
)
def test_a_bench_file_that_cannot_be_is_refused(changes, told):
    with pytest.raises(InputError, match=told):
        BENCH.with_(**changes)


def test_the_step_is_the_least_squares_within_bounds_where_they_are_known():
    """Beside SciPy, on draws where at most one bound holds: then taking it out is the optimum."""
    random = np.random.default_rng(5)
    for _ in range(50):
        softening, left = random.normal(size=(3, 3)), random.normal(size=3)
        squares, most = random.uniform(0.5, 1.0, 3), np.full(3, 2.0)
        a, right = _NEARER @ softening.T, _NEARER @ (left + softening.T @ squares)
        best = lsq_linear(a, right, (np.zeros(3), most), method="bvls")
        found = nulling(squares, softening, left, most)
        assert np.all((found >= 0.0) & (found <= most))
        if np.count_nonzero(best.active_mask) == 0:
            np.testing.assert_allclose(found, best.x, atol=1e-6)
