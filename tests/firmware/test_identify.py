"""`hil identify` of the C board on a pty, with a witness on the line: what it finds, its limits, every way out."""

import json
import os
import signal
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from estimator.identify.schedule import Lengths, Table
from hil.boards.identity import identity_at
from hil.cli import execute
from hil.errors import InputError
from hil.identifying import identify as identifying
from hil.identifying import page
from hil.identifying.recording import Experiment, played, ticks
from hil.numbers import count
from hil.progress import untold
from hil.running.process import supervision  # noqa: F401 - loaded, so that its process is a fork
from hil.wire.messages import Arm, Identity, Message, SafeReason
from hil.wire.sense import Sense
from tests.cli.conftest import Start, finished, forked  # noqa: F401
from tests.cli.conftest import start as started  # noqa: F401
from tests.cli.test_processes import children_of

from .process import pty_board
from .test_run import SLOW
from .witness import Changed, Witness, witnessed

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("no_report")]

SHORT = Lengths(1500, 1500, 500, 800, 1500, (1500, 1500), (3000, 3000))
RATE_HZ, FULL_MPS2, FULL_V = 4000.0, 10.0, 0.25  # firmware/examples/resonator.c
SHARE = 0.3  # of the drive's range


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """A shorter experiment, in this process, without a page."""
    monkeypatch.setattr(identifying, "LENGTHS", SHORT)
    monkeypatch.setattr(page, "write_page", lambda *_: None)


@contextmanager
def on_the_line(built: Path, *options: str, changed: Changed | None = None) -> Iterator[tuple[Any, Witness]]:
    """The board's process, which stands still, and the witness before it."""
    with pty_board(built, "--rate", "0", *options) as (process, url), witnessed(url, changed) as witness:
        yield process, witness


def identified(
    witness: Witness, place: Path, said: pytest.CaptureFixture[str], *options: str
) -> tuple[int, dict[str, Any], str]:
    """Exit code, the object printed, standard error."""
    said.readouterr()
    code = execute(
        ["identify", witness.url, "--arm", "--json", "-o", str(place / "my.bench.toml"), "--runs", str(place), *options]
    )
    told = said.readouterr()
    return code, json.loads(told.out) if told.out else {}, told.err


@pytest.mark.usefixtures("short")
@pytest.mark.parametrize("latency", [1, 3])
def test_it_is_found_within_its_limits_and_left_safe(
    built: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], latency: int
) -> None:
    limits = ("--drive-limit", str(SHARE * FULL_MPS2), "--sense-limit", "0.1")
    with on_the_line(built, "--latency", str(latency)) as (_, witness):
        code, found, err = identified(witness, tmp_path, capsys, *limits)
    assert code == 0, err
    assert found["latency_ticks"] == {"measured": latency, "identity": latency}
    constants = found["constants"]
    truth = {name: SLOW[name] for name in ("kxx", "kyy", "kxy", "dxx", "dyy", "dxy")} | {
        "gain_x": 1000.0, "gain_y": 1000.0, "share_xy": 0.0, "share_yx": 0.0, "delay": 0.0, "rate": 0.0,
        "offset_x": SLOW["phi_x"], "offset_y": SLOW["phi_y"],
    }  # fmt: skip
    z = np.array([(constants[name]["value"] - value) / constants[name]["u"] for name, value in truth.items()])
    assert np.abs(z).max() < 4.0
    assert 0 < witness.largest() <= int(SHARE * 2**15)
    assert witness.stops() == witness.told_to_stop()[:2] == [SafeReason.HOST_REQUEST] * 2
    rows = [message.codes for _, message in witness.heard if isinstance(message, Sense)]
    volts = np.concatenate(rows)[:, :2] * FULL_V / 2**15
    assert (np.abs(volts) > 0.1).mean() < 0.01
    assert len(volts) <= ticks(SHORT) + 2  # of each part the row that it begins with, too
    assert f"experiment: at most {count(ticks(SHORT))} ticks, " in err


@pytest.mark.parametrize(("number", "part"), [(signal.SIGINT, 2), (signal.SIGTERM, 1)])
def test_an_interruption_ends_in_safe(
    built: Path,
    tmp_path: Path,
    started: Start,  # noqa: F811
    number: signal.Signals,
    part: int,
) -> None:
    with on_the_line(built) as (_, witness):
        host = started("identify", witness.url, "--arm", "-o", "my.bench.toml")
        witness.wait_until_driven(part)
        host.send_signal(number)
        code, out, err = finished(host)
    assert (code, out) == (130, "")
    assert "SAFE was confirmed" in err
    assert witness.stops()[-1] == SafeReason.INTERRUPTED
    assert not (tmp_path / "my.bench.toml").exists()


@pytest.mark.parametrize("killed", ["command", "loop"])
def test_whichever_process_is_killed_the_other_has_it_safe(
    built: Path,
    tmp_path: Path,
    forked: Start,  # noqa: F811
    killed: str,
) -> None:
    with on_the_line(built) as (_, witness):
        host = forked("identify", witness.url, "--arm", "-o", "my.bench.toml")
        witness.wait_until_driven(1)
        os.kill(host.pid if killed == "command" else max(children_of(host.pid)), signal.SIGKILL)
        finished(host)
        witness.wait_for_stop()
    assert witness.stops() == witness.told_to_stop()[:1]
    assert not (tmp_path / "my.bench.toml").exists()


def test_a_host_that_is_gone_altogether_leaves_a_board_that_drives_nothing(
    built: Path,
    tmp_path: Path,
    forked: Start,  # noqa: F811
) -> None:
    """In lockstep a board on a pty ends with its host."""
    with on_the_line(built) as (board, witness):
        host = forked("identify", witness.url, "--arm", "-o", "my.bench.toml")
        witness.wait_until_driven(1)
        for process in (*children_of(host.pid), host.pid):
            os.kill(process, signal.SIGKILL)
        assert board.wait(20.0) == 0


def test_a_board_without_its_supply_is_named_and_gets_no_file(
    built: Path,
    tmp_path: Path,
    forked: Start,  # noqa: F811
) -> None:
    with on_the_line(built) as (board, witness):
        host = forked("identify", witness.url, "--arm", "-o", "my.bench.toml")
        witness.wait_until_driven(1)
        board.kill()
        code, out, err = finished(host)
    assert (code, out) == (2, "")
    assert "Traceback" not in err
    assert "the record so far" in err.splitlines()[-1]
    assert not (tmp_path / "my.bench.toml").exists()


@pytest.mark.usefixtures("short")
@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("--drive-limit", "10.1"), "the board's converters end at"),
        (("--drive-limit", "1e-5"), "less than one drive code"),
        (("--sense-limit", "0.3"), "the board's converters end at"),
    ],
)
def test_limits_that_are_none_are_refused_before_it_is_armed(
    built: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], options: tuple[str, ...], told: str
) -> None:
    with on_the_line(built) as (_, witness):
        code, _, err = identified(witness, tmp_path, capsys, *options)
    assert code == 2
    assert told in err
    assert not any(isinstance(message, Arm) for _, message in witness.heard)


@pytest.mark.parametrize("drive", [np.nan, np.inf])
def test_a_drive_that_is_no_number_is_refused_before_it_is_armed(built: Path, tmp_path: Path, drive: float) -> None:
    forces = np.zeros((100, 2))
    forces[50] = drive
    with on_the_line(built) as (_, witness):
        identity = identity_at(witness.url)
        experiment = Experiment(witness.url, identity, 1.0, np.full(2, 0.1), "lockstep", SHORT)
        with pytest.raises(InputError, match="finite"):
            played(experiment, Table(forces, np.zeros(100, np.int32), ("all",)), tmp_path, "wrong", untold)
    assert not any(isinstance(message, Arm) for _, message in witness.heard)


def cable(*, sense: list[list[int]] | None = None, late: int = 0, echo: int = 0, **factors: float) -> Changed:
    """One that changes what a board says: (2, 2) by which sense codes are multiplied; samples by which sense codes, or
    the echo of the drive, come late; so many times of a field of IDENTITY.
    """
    rows = deque([[0, 0, 0, 0]] * (late + echo), late + echo + 1)

    def changed(message: Message) -> Message:
        if isinstance(message, Identity):
            return message._replace(**{name: getattr(message, name) * factor for name, factor in factors.items()})
        if not isinstance(message, Sense):
            return message
        said = []
        for row in message.codes.tolist():
            rows.append(row)
            sensed, shown = (rows[0] if one else row for one in (late, echo))
            said.append([*(np.array(sense or [[1, 0], [0, 1]]) @ sensed[:2]), *shown[2:]])
        return message._replace(codes=np.array(said, np.int32))

    return changed


WRONG: dict[str, tuple[Changed, bool, str]] = {
    "sense a tick late": (cable(late=1), False, "acts 1.000 ± "),
    "sense two ticks late": (cable(late=2), False, "acts 2.000 ± "),
    "channels exchanged": (cable(sense=[[0, 1], [1, 0]]), False, "exchange the channels"),
    "sense x turned round": (cable(sense=[[-1, 0], [0, 1]]), False, "unlike signs"),
    "sense y turned round": (cable(sense=[[1, 0], [0, -1]]), False, "unlike signs"),
    "both turned round": (cable(sense=[[-1, 0], [0, -1]]), True, "wrong way round"),
    "sense scale twice": (cable(sense_scale_V=2.0), True, "2 × the declared gain"),
    "drive scale half": (cable(drive_scale_mps2=0.5), True, "2 × the declared gain"),
}


@pytest.mark.usefixtures("short")
def test_an_echo_a_tick_late_ends_it(built: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A drive that is not the one asked for, at its tick."""
    with on_the_line(built, changed=cable(echo=1)) as (_, witness):
        code, _, err = identified(witness, tmp_path, capsys)
    assert code == 2
    assert "shows the drive codes" in err
    assert witness.stops()[-1:] == witness.told_to_stop()[:1]


@pytest.mark.usefixtures("short")
@pytest.mark.beyond(3)
@pytest.mark.parametrize("kind", WRONG)
def test_what_a_board_says_wrongly_of_itself_is_named_and_gets_no_file(
    built: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str
) -> None:
    changed, declared, words = WRONG[kind]
    like = ("--like", "c-board") if declared else ()
    with on_the_line(built, "--latency", "2", changed=changed) as (_, witness):
        code, found, err = identified(witness, tmp_path, capsys, *like)
    assert code == 1, err
    assert any(words in fault for fault in found["faults"]), found["faults"]
    assert witness.stops() == [SafeReason.HOST_REQUEST] * 2
    assert not (tmp_path / "my.bench.toml").exists()
