"""The reference of a run: a commercial gyro on the same table, recorded beside it by a process of its own.

Nothing of the loop waits for it. It has to speak before the board is armed; what becomes of it afterwards is told in
the result, and stops nothing.
"""

import json
import select
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from hil.bench import Bench
from hil.errors import InputError
from hil.records.runfolder import RunFolder

_SPEAKS_S = 15.0  # to be recognised, and its rate learned
_ENDS_S = 10.0
_TABLE = "[reference] link"


def require_reference(bench: Bench, link: str, *, dry_run: bool) -> None:
    """InputError, one line, where the reference of a bench cannot be recorded beside a run on `link`."""
    from hil.sensors.port import find_port

    wanted = bench.reference.link
    assert wanted is not None
    port = find_port(wanted)
    if port.kind == "replay":
        raise InputError(f"{_TABLE}: {wanted} is a file; give a sensor that speaks during the run")
    if bench.loop.clock == "lockstep" and not dry_run:
        raise InputError(f'{_TABLE}: {wanted} lives on wall time; give [loop] clock = "paced" or "real"')
    if port.path in (link, link.partition(":")[2].partition("?")[0]):
        raise InputError(f"{_TABLE}: {wanted} is the line of the board itself; give that of the sensor")


class Beside:
    """The process, and what it has said."""

    def __init__(self, process: "subprocess.Popen[bytes]", link: str) -> None:
        self._process, self._link = process, link
        self.told: dict[str, Any] = {}

    def await_speech(self, axis: str) -> None:
        """Raises InputError with what it says where it does not speak, or has no such axis."""
        assert self._process.stdout is not None
        ready, _, _ = select.select([self._process.stdout], (), (), _SPEAKS_S)
        line = self._process.stdout.readline() if ready else b""
        said = json.loads(line) if line else {"error": f"{self._link}: its recorder said nothing in {_SPEAKS_S:g} s"}
        if "error" in said:
            raise InputError(f"[reference] {said['error']}")
        axes = [name[5:-5] for name in said["channels"] if name.startswith("rate_")]
        if axis not in axes:
            raise InputError(f"[reference] axis: {said['device']} has no rate {axis!r}; it has {', '.join(axes)}")

    def end(self) -> dict[str, Any]:
        """Have it close its record; what came of it. `fault` where it does not say."""
        if not self.told:
            try:
                said, _ = self._process.communicate(timeout=_ENDS_S)
                self.told = json.loads(said.split(b"\n")[0])
            except (subprocess.TimeoutExpired, ValueError):
                self._process.kill()
                self.told = {"error": f"its recorder ended with code {self._process.wait()}, and said nothing"}
        return self.told


@contextmanager
def recorded_beside(bench: Bench, folder: Path) -> Iterator[Beside | None]:
    """The reference of the bench, where it has one, that speaks by now; ended with the block. Raises InputError."""
    link = bench.reference.link
    if link is None:
        yield None
        return
    command = [sys.executable, "-m", "hil.sensors.beside", link, str(RunFolder(folder).reference_path)]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, start_new_session=True) as process:
        beside = Beside(process, link)
        try:
            beside.await_speech(bench.reference.axis)
            yield beside
            beside.end()
        finally:
            process.kill()
