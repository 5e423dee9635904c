"""A drive or a sense channel that is the wrong way round is told as such, with its axis; a right one never."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from estimator.observer import Observer
from hil.inputs.declared import board_device_of, controller_settings_of, observer_settings_of
from hil.records.runfolder import RunFolder
from hil.running.recording.recorder import record_here
from hil.running.request import RunRequest
from hil.running.run import run
from hil.running.safety.opening import Opening, wrong_way
from hil.running.safety.preflight import configure
from hil.wire import client
from hil.wire.endpoint import Endpoint
from hil.wire.messages import Identity, SafeReason, State
from tests.running import closed, gyro, misbehaving
from tests.running.test_stops import Told
from tests.running.test_stops import bench as slow_bench

GAIN = {"mode": "gain", "block": 20, "estimate_every": 20}
QUIET = {"dither_mps2": 0.0, "virtual_rotation_rad_s": 0.0}


def told_of(
    tmp_path: Path, signs: tuple[int, int], loop: dict[str, Any], controller: dict[str, Any], **scenario: Any
) -> str:
    """What the opening of a run has to say whose bench file declares the sense gains with these signs turned."""
    gains = tuple(-885.42 * sign for sign in signs)
    bench = gyro.bench(0.6, loop=loop, device={"sense": {"gain_V_per_m": gains}}, controller=controller)
    endpoint = Endpoint(closed.waiting(gyro.scenario(tmp_path / "board.toml", **scenario)))
    identity: Identity = client.connect(endpoint)

    def observer() -> Observer:
        return Observer(board_device_of(bench), observer_settings_of(bench), controller_settings_of(bench, identity))

    registers = configure(endpoint, identity, bench)
    ours = observer()
    folder = tmp_path / "run"
    folder.mkdir()
    with record_here(folder, closed.run_layouts(ours, bench, identity)) as recording:
        what = closed.make_loop(endpoint, identity, bench, ours, recording.tracks, registers)
        what.arm()
        what.run(round(0.6 * identity.tick_rate_Hz), lambda _: None, 10_000)
        what.finish(SafeReason.HOST_REQUEST)
    endpoint.close()
    assert isinstance(what.opening, Opening)
    return what.opening.wrong_way(observer)


@pytest.mark.moderate
@pytest.mark.parametrize("loop", [{}, GAIN], ids=["force", "gain"])
@pytest.mark.parametrize("controller", [{}, QUIET], ids=["dithered", "quiet"])
@pytest.mark.parametrize(
    ("signs", "words"),
    [
        ((1, 1), ""),
        ((-1, 1), "the drive of x acts the wrong way round"),
        ((1, -1), "the drive of y acts the wrong way round"),
        ((-1, -1), "the drives of x and y act the wrong way round"),
    ],
)
def test_each_sign_of_each_axis(
    tmp_path: Path, loop: dict[str, Any], controller: dict[str, Any], signs: tuple[int, int], words: str
) -> None:
    told = told_of(tmp_path, signs, loop, controller)
    assert told.startswith(words)
    assert bool(told) == bool(words)


@pytest.mark.moderate
@pytest.mark.parametrize(
    "scenario",
    [
        {"sense": {"noise_V": 8.9e-3}},  # 20 dB
        {"sense": {"mismatch_m": (4e-5, -4e-5)}},  # offsets of 40 % of the amplitude
        {"truth": {"stiffness_N_per_m": (1750.0, 1400.0, 60.0)}},  # 10 % and 12 % off
        {"rate": {"kind": "constant", "rate_rad_s": -6.0}},
    ],
    ids=["noisy", "offset", "mistuned", "turning"],
)
def test_what_else_is_wrong_is_not_taken_for_a_sign(tmp_path: Path, scenario: dict[str, Any]) -> None:
    assert told_of(tmp_path, (1, 1), {}, {}, **scenario) == ""


@pytest.mark.slow
@pytest.mark.usefixtures("no_report")
@pytest.mark.parametrize(
    ("signs", "words"),
    [
        ((-1, 1, 1, 1), "the drive of x acts the wrong way round"),
        ((1, -1, 1, 1), "the drive of y acts the wrong way round"),
        ((1, 1, 1, -1), "the drive of y acts the wrong way round"),
        ((-1, -1, 1, 1), "the drives of x and y act the wrong way round"),
    ],
)
def test_a_run_says_it_first(tmp_path: Path, signs: tuple[int, ...], words: str) -> None:
    with misbehaving.served(misbehaving.Turned(*signs)) as board:
        done = run(RunRequest(slow_bench(6.0, "lockstep"), board.url), tmp_path, progress=Told())
    assert done.folder is not None
    result = RunFolder(done.folder).result
    assert result is not None
    assert result.verdict in ("interrupted", "failed")
    assert words in result.reasons[0]
    assert result.parts["safety"].outcome == "failed"
    assert board.state is State.SAFE


# ------------------------------------------------------------------------------ the rule itself, on innovations by hand


class Predicts:
    """In an observer's place: `nis` says by the signs of the drive how well it predicts the samples, from row
    `BEGIN` on, where the drive begins; before that and where samples are lost, it predicts nothing.
    """

    BEGIN, LOST, ROWS = 3, 6, 9

    def __init__(self, nis: dict[tuple[int, int], float]) -> None:
        self.nis = nis
        self.asked: list[tuple[int, int]] = []
        self.gone: tuple[int, int] | None = None  # signs with which it is lost at a row, …
        self.gone_at = -1  # … the last one

    def run(self, sense_V: np.ndarray, drive: np.ndarray) -> SimpleNamespace:
        signs = (int(drive[-1, 0]) or 1, int(drive[-1, 1]) or 1)
        self.asked.append(signs)
        spread = np.full((self.ROWS, 2), 0.5)
        size = np.sqrt(self.nis[signs] * np.array([0.5, 1.5]))  # the axes count alike
        innovation = np.tile(size, (self.ROWS, 1)) * spread
        innovation[: self.BEGIN] = 1e3
        innovation[self.LOST] = 1e6
        if signs == self.gone:
            innovation[self.gone_at] = np.nan
        return SimpleNamespace(innovation=innovation, innovation_deviation=spread)

    def told(self, driven: tuple[int, int] = (1, 1)) -> str:
        drive = np.zeros((self.ROWS, 2))
        drive[self.BEGIN :] = driven
        sense = np.zeros((self.ROWS, 2))
        sense[self.LOST] = np.nan
        return wrong_way(gyro.bench(0.6), lambda: self, sense, drive)


ALL_WELL = {(1, 1): 1.0, (1, -1): 1.0, (-1, 1): 1.0, (-1, -1): 1.0}


@pytest.mark.parametrize(
    ("declared", "turned", "told"),
    [
        (100.0, 1.0, True),
        (4.5, 1.0, True),  # four times worse is worse
        (3.5, 1.0, False),
        (100.0, 3.5, True),  # four is predicted well enough
        (100.0, 4.5, False),
        (2.0, 0.45, True),
        (0.45, 1.0, False),
        (float("nan"), 1.0, True),  # an observer that is lost predicts nothing
        (100.0, float("nan"), False),
    ],
)
def test_other_signs_have_to_predict_well_and_the_declared_ones_far_worse(
    declared: float, turned: float, told: bool
) -> None:
    usual = dict.fromkeys(ALL_WELL, 200.0)
    found = Predicts(usual | {(1, 1): declared, (1, -1): turned}).told()
    assert found.startswith("the drive of y acts the wrong way round: check the sign of") == told
    assert bool(found) == told


def test_an_observer_that_is_lost_at_a_single_row_predicts_nothing() -> None:
    observer = Predicts(dict.fromkeys(ALL_WELL, 100.0) | {(1, 1): 2.0, (1, -1): 1.0})
    assert observer.told() == ""
    observer.gone = 1, 1
    for row in (observer.BEGIN, observer.ROWS - 1):  # the first row that is driven counts, as the last
        observer.gone_at = row
        assert observer.told().startswith("the drive of y acts")
    observer.gone_at = observer.BEGIN - 1
    assert observer.told() == ""


def test_only_signs_of_axes_that_were_driven_are_tried() -> None:
    for driven, signs in (((1, 0), {(1, 1), (-1, 1)}), ((0, 1), {(1, 1), (1, -1)}), ((1, 1), set(ALL_WELL))):
        observer = Predicts(ALL_WELL)
        assert observer.told(driven) == ""
        assert len(observer.asked) == len(signs)
        assert set(observer.asked) == signs
    assert Predicts(ALL_WELL).told((0, 0)) == ""


def test_a_record_without_a_sample_after_the_first_drive_tells_nothing() -> None:
    observer = Predicts(dict.fromkeys(ALL_WELL, 100.0) | {(-1, 1): 1.0})
    drive = np.zeros((observer.ROWS, 2))
    drive[observer.BEGIN :] = 1.0
    lost = np.full((observer.ROWS, 2), np.nan)
    assert wrong_way(gyro.bench(0.6), lambda: observer, lost, drive) == ""
