"""What `hil generate` wrote closes the loop on a board: on this machine, and on a Cortex-M7 in QEMU."""

import subprocess
from pathlib import Path

import numpy as np
import pytest

import hil
from hil.bench import Bench, load_bench, override
from hil.progress import untold
from hil.records.runfolder import RunFolder
from hil.running.request import RunRequest
from hil.running.run import run
from tests.made_once import made_once

from .conftest import FIRMWARE, make
from .mps2 import mps2_board, require
from .process import pty_board

EXAMPLES = Path(__file__).parents[2] / "examples"
BLOCK = 2
SENSE_SCALE_V = 0.25 / 2**15
"""Of the example boards, resonator.c."""
SETTLE_S, TEN_TURNS_S = 1.5, 40.0

pytestmark = [pytest.mark.slow]


def declared(mode: str, *, acquisition_s: float = 0.1, duration_s: float = 3.0, **loop: object) -> Bench:
    bench = load_bench(EXAMPLES / "c-board.bench.toml")
    keys = {"mode": mode, "duration_s": duration_s, "settle_s": SETTLE_S, "block": BLOCK, **loop}
    if mode != "board":
        del keys["block"]
    return override(bench, {"loop": keys, "observer": {"acquisition_s": acquisition_s}}, "test")


def generated(out: Path, *, float32: bool = False, sense_scale: float = SENSE_SCALE_V) -> Path:
    """The estimator of the example board's bench file."""
    hil.generate(load_bench(EXAMPLES / "c-board.bench.toml"), out=out, sense_scale=sense_scale, float32=float32)
    return out


@pytest.fixture(scope="session")
def estimator(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as `hil generate` leaves it, in double."""
    return made_once(tmp_path_factory, "estimator", generated)


@pytest.fixture(scope="session")
def boards(estimator: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The example boards with that estimator."""
    return made_once(tmp_path_factory, "own-loop", lambda place: make(place, "all", f"ESTIMATOR={estimator}"))


@pytest.fixture(scope="session")
def cross_boards(estimator: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    require()
    return made_once(tmp_path_factory, "own-mps2", lambda place: make(place, "mps2", f"ESTIMATOR={estimator}"))


def ran(bench: Bench, url: str, place: Path) -> RunFolder:
    """The folder of a run whose verdict is good."""
    done = run(RunRequest(bench, url), place, report=False, progress=untold)
    assert done.folder is not None
    folder = RunFolder(done.folder)
    result = folder.result
    assert result is not None
    assert (result.verdict, result.reasons, result.lost) == ("good", (), 0)
    return folder


def assert_the_same_loop(on_board: RunFolder, by_host: RunFolder) -> None:
    """Every code of the drive, and the estimates that led to it."""
    board, own = on_board.capture, on_board.board_estimates
    host, theirs = by_host.capture, by_host.estimates
    assert board is not None
    assert host is not None
    assert own is not None
    assert theirs is not None
    first = int(np.flatnonzero(np.abs(board.drive).sum(axis=1))[0])
    assert first < 500
    np.testing.assert_array_equal(board.drive, host.drive)
    np.testing.assert_array_equal(board.sense_V, host.sense_V)
    said = len(own.tick)
    assert said >= len(theirs.tick) - 1  # the last one comes behind the last sample, with which the run ends
    np.testing.assert_array_equal(own.tick, theirs.tick[:said])
    for name, tolerance in (("angle_rad", 1e-12), ("rate_rad_s", 1e-9)):
        np.testing.assert_allclose(own[name], theirs[name][:said], rtol=0.0, atol=tolerance)
    np.testing.assert_allclose(own["sd_rate_rad_s"], theirs["sd_rate_rad_s"][:said], rtol=1e-6)  # travels in 32 bits


def host_closes() -> Bench:
    """The bench in force mode, so that the loop closes at the very sample at which board mode permits the drive."""
    samples = int(0.1 * 4000) + BLOCK
    return declared("force", acquisition_s=samples / 4000.0)


@pytest.fixture(scope="module")
def on_m7(cross_boards: Path, tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    with mps2_board(cross_boards) as url:
        return ran(declared("board"), url, tmp_path_factory.mktemp("on-m7"))


def test_on_this_machine_it_is_the_hosts_own_loop_code_by_code(boards: Path, tmp_path: Path) -> None:
    with pty_board(boards, "--estimator") as (_, url):
        board = ran(declared("board"), url, tmp_path / "board")
    with pty_board(boards) as (_, url):
        host = ran(host_closes(), url, tmp_path / "host")
    assert_the_same_loop(board, host)


def test_on_a_cortex_m7_it_is_the_hosts_own_loop_code_by_code(
    on_m7: RunFolder, cross_boards: Path, tmp_path: Path
) -> None:
    with mps2_board(cross_boards) as url:
        host = ran(host_closes(), url, tmp_path)
    assert_the_same_loop(on_m7, host)


@pytest.mark.long
@pytest.mark.timeout(900)
def test_ten_turns_in_32_bits_on_a_cortex_m7_are_those_of_double(tmp_path: Path) -> None:
    """Each closes its own loop, that in double on this machine. The converter has 24 bits: with 16, its rounding alone
    takes two loops in double as far apart (`python -m evaluation.two_loops`)."""
    require()
    bench = override(
        declared("board", duration_s=SETTLE_S + TEN_TURNS_S, block=20), {"limits": {"angle_rad": 1.0}}, "test"
    )  # how well the angle is known after so long is not the question
    bits, rate = 24, 20.0 * np.pi / TEN_TURNS_S
    places = {float32: tmp_path / f"{32 if float32 else 64}" for float32 in (True, False)}
    for float32, place in places.items():
        generated(place / "estimator", float32=float32, sense_scale=0.25 / 2 ** (bits - 1))
    options = f"DEFINE=-DRATE_RAD_S={rate} -DSENSE_BITS={bits}"
    cross = make(places[True] / "build", "mps2", f"ESTIMATOR={places[True] / 'estimator'}", options)
    here = make(places[False] / "build", "all", f"ESTIMATOR={places[False] / 'estimator'}")
    with mps2_board(cross) as url:
        short = ran(bench, url, tmp_path / "m7").board_estimates
    with pty_board(here, "--estimator", "--rate", str(rate), "--sense-bits", str(bits)) as (_, url):
        double = ran(bench, url, tmp_path / "here").board_estimates
    assert short is not None
    assert double is not None
    np.testing.assert_array_equal(short.tick, double.tick)
    assert double["angle_rad"][-1] / (2 * np.pi) == pytest.approx(10.0, abs=0.05)
    scored = short.t_s >= SETTLE_S
    apart = (short["angle_rad"] - double["angle_rad"])[scored]
    assert np.abs(apart - apart[0]).max() < 1e-4


def test_its_estimates_are_summed_up_and_compared(on_m7: RunFolder, tmp_path: Path) -> None:
    result = on_m7.result
    assert result is not None
    assert result.board is not None
    apart = result.board.angle_difference_rms_rad
    assert apart is not None
    assert apart < 1e-9  # beside the host's observer of the same samples
    methods = hil.compare(on_m7.path, report=False, out=tmp_path)
    assert "on the board" in [row.name for row in methods.rows]
    assert methods.remarks[0] == f"on the board, less the host's: {result.board.line}"
    assert result.board.line.startswith("angle ")


def test_a_board_of_other_codes_is_told_in_one_line(tmp_path: Path) -> None:
    out = tmp_path / "other"
    hil.generate(load_bench(EXAMPLES / "c-board.bench.toml"), out=out, latency=2, sense_scale=SENSE_SCALE_V)
    place = make(tmp_path, f"{tmp_path}/pty_board", f"ESTIMATOR={out}")
    done = subprocess.run([place / "pty_board", "--estimator"], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr == "pty_board: the estimator was written for another latency; generate it for this board\n"
    assert done.stdout == ""


def test_an_estimator_of_another_version_is_not_built(estimator: Path, tmp_path: Path) -> None:
    for name in ("gyro_estimator.h", "gyro_estimator.c"):
        text = (estimator / name).read_text()
        (tmp_path / name).write_text(text.replace("GYRO_ESTIMATOR_VERSION 2u", "GYRO_ESTIMATOR_VERSION 3u"))
    told = [line for line in refused(tmp_path) if "error" in line]
    assert "estimating.c is for version 2 of gyro_estimator.h" in told[0]


def test_an_estimator_without_a_function_is_not_built(estimator: Path, tmp_path: Path) -> None:
    (tmp_path / "gyro_estimator.h").write_text((estimator / "gyro_estimator.h").read_text())
    text = (estimator / "gyro_estimator.c").read_text()
    (tmp_path / "gyro_estimator.c").write_text(text.replace("void gyro_estimator_read(", "void another_read("))
    told = [line for line in refused(tmp_path) if "gyro_estimator_read" in line]
    assert "undefined reference to `gyro_estimator_read'" in told[-1]


def refused(estimator: Path) -> list[str]:
    """What a build of the example board with it says."""
    command = ["make", "--silent", "-C", str(FIRMWARE), f"BUILD={estimator}", f"ESTIMATOR={estimator}"]
    done = subprocess.run([*command, f"{estimator}/pty_board"], capture_output=True, text=True, check=False)
    assert done.returncode != 0
    return done.stderr.splitlines()


@pytest.mark.usefixtures("no_report")
def test_a_nan_of_the_boards_estimator_ends_in_safe_with_one_line(boards: Path, tmp_path: Path) -> None:
    with pty_board(boards, "--estimator", "--wrong", "1.0:nan") as (_, url):
        done = run(RunRequest(declared("board"), url), tmp_path, report=False, progress=untold)
    assert done.folder is not None
    folder = RunFolder(done.folder)
    result = folder.result
    assert result is not None
    (told,) = [reason for reason in result.reasons if "the board's own estimate" in reason]
    assert "rate is nan, which is no number; correct the board's estimator" in told
    assert "\n" not in told
    assert result.verdict == "interrupted"
