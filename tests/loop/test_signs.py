"""A drive or a sense channel that is the wrong way round is told as such, with its axis; a right one never."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from estimator.observer import Observer
from hil.declared import controller_settings_of, device_of, observer_settings_of
from hil.loop.opening import Opening
from hil.loop.preflight import configure
from hil.loop.run import run
from hil.loop.signs import wrong_way
from hil.records.recorder import record_here
from hil.records.runfolder import RunFolder
from hil.wire import client
from hil.wire.endpoint import Endpoint
from hil.wire.messages import Identity, SafeReason, State
from tests.loop import closed, gyro, misbehaving
from tests.loop.test_stops import Told
from tests.loop.test_stops import bench as slow_bench

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
        return Observer(device_of(bench), observer_settings_of(bench), controller_settings_of(bench, identity))

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
        done = run(slow_bench(6.0, "lockstep"), board.url, tmp_path, progress=Told())
    assert done.folder is not None
    result = RunFolder(done.folder).result
    assert result is not None
    assert result.verdict in ("interrupted", "failed")
    assert words in result.reasons[0]
    assert result.parts["safety"].outcome == "failed"
    assert board.state is State.SAFE


@pytest.mark.parametrize("samples", [1, 2])
def test_two_samples_are_looked_at_and_one_is_not(samples: int) -> None:
    asked = []

    def observer() -> Observer:
        asked.append(samples)
        raise NotImplementedError

    bench, seen = gyro.bench(0.6), np.ones((samples, 2))
    if samples == 1:
        assert wrong_way(bench, observer, seen, seen) == ""
    else:
        with pytest.raises(NotImplementedError):
            wrong_way(bench, observer, seen, seen)
    assert len(asked) == samples - 1
