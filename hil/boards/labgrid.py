"""A board of a labgrid place, `labgrid:PLACE`: acquired before a link is opened, held while it is used, released after.

labgrid's own client is called, `labgrid-client`, which finds the coordinator as always (LG_COORDINATOR). It stays in
an environment of its own, since labgrid replaces pyserial by another package of the same name. The link of the board
is the place's tag `link`.

`python -m hil.boards.labgrid PLACE` holds a place until its standard input ends, so that it is released when the
process that wanted it is killed, too.
"""

import json
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from hil.errors import InputError, printable
from hil.wire.errors import LinkError
from hil.wire.link_name import Emulated, LabgridPlace, parse_link

CLIENT = "labgrid-client"
_TAG = re.compile(r"^\s*tags:.*?\blink=([^,\s]+)", re.MULTILINE)
_ANSWER_S, _RELEASE_S = 60.0, 90.0


@contextmanager
def leased(place: str) -> Iterator[str]:
    """The link of the board at a place, which is held for the length of the block. Raises InputError where it cannot be
    had, or has no link."""
    keeper = subprocess.Popen(
        [sys.executable, "-m", "hil.boards.labgrid", place],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        start_new_session=True,  # Ctrl-C comes to the host, which sends SAFE first
    )
    assert keeper.stdin is not None
    assert keeper.stdout is not None
    with keeper:
        try:
            line = keeper.stdout.readline()
            said = json.loads(line) if line else {"error": f"labgrid:{place}: its keeper died; repeat the command"}
            if "error" in said:
                raise InputError(said["error"])
            yield said["link"]
        finally:
            keeper.stdin.close()
            keeper.wait(_RELEASE_S)


def main(place: str) -> int:
    """Acquire, tell the link, wait for the end of standard input, release."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    try:
        _called(place, "acquire")
    except InputError as error:
        print(json.dumps({"error": str(error)}), flush=True)
        return 2
    try:
        try:
            print(json.dumps({"link": _link_of(place)}), flush=True)
        except InputError as error:
            print(json.dumps({"error": str(error)}), flush=True)
        sys.stdin.buffer.read()
    finally:
        try:
            _called(place, "release")
        except InputError as error:
            print(printable(f"hil: {error}; it is still acquired"), file=sys.stderr, flush=True)
    return 0


def _link_of(place: str) -> str:
    found = _TAG.search(_called(place, "show"))
    if found is None:
        remedy = f"{CLIENT} -p {place} set-tags link=serial:/dev/ttyACM0"
        raise InputError(f"labgrid:{place}: the place does not say where its board is; give it a tag: {remedy}")
    try:
        if isinstance(parse_link(found[1]), Emulated | LabgridPlace):
            raise InputError(f"labgrid:{place}: its tag link={found[1]} leads to no board; correct the tag")
    except LinkError as error:
        raise InputError(f"labgrid:{place}: its tag link: {error}") from None
    return found[1]


def _called(place: str, verb: str) -> str:
    """What the client prints; InputError with its words where it refuses."""
    client = shutil.which(CLIENT)
    if client is None:
        raise InputError(f"labgrid:{place}: {CLIENT} is not there; pipx install labgrid, apart from this bench")
    try:
        done = subprocess.run(
            [client, "-p", place, verb], capture_output=True, text=True, timeout=_ANSWER_S, check=False
        )
    except subprocess.TimeoutExpired:
        raise InputError(
            f"labgrid:{place}: no answer to {verb} in {_ANSWER_S:g} s; is the coordinator there?"
        ) from None
    if done.returncode:
        words = (done.stderr.strip() or done.stdout.strip()).splitlines()
        said = words[-1].removeprefix(f"{CLIENT}: ").removeprefix("Error: ") if words else f"code {done.returncode}"
        raise InputError(f"labgrid:{place}: {verb} refused: {said[:200]}")
    return done.stdout


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
