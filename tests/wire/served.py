"""The emulated board, served on a link."""

import subprocess
import sys
import tempfile
from pathlib import Path

from hil.testing.board_rules.served import PATIENCE_S, QUIET_S, Board, Cable, leave
from tests.emulator.gyro import EXAMPLES

__all__ = ["PATIENCE_S", "QUIET_S", "Board", "Cable", "emulated", "leave", "tripped"]

SLOWLY = ("sample_rate_Hz = 4000", "sample_rate_Hz = 500")
"""On wall time both ends may have to share one processor, with links that take a millisecond a frame."""


def emulated(link: str, faults: str = "", start: type[subprocess.Popen[str]] = subprocess.Popen) -> Board:
    """The emulated board on a link; `faults` is TOML for the end of its scenario, `start` makes its process."""
    text = (EXAMPLES / "s-slow.scenario.toml").read_text(encoding="utf-8")
    assert SLOWLY[0] in text
    with tempfile.TemporaryDirectory() as place:
        scenario = Path(place, "slow.scenario.toml")
        scenario.write_text(f"{text.replace(*SLOWLY)}\n{faults}", encoding="utf-8")
        command = [sys.executable, "-W", "error", "-m", "device_emulator", str(scenario), "--link", link]
        return Board(command, start=start)


def tripped(first_s: float, duration_s: float) -> str:
    """The emulated board's own protection trips: for `emulated`."""
    return f"[[faults.tripped]]\nstart_s = {first_s}\nduration_s = {duration_s}\n"
