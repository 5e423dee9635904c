"""The least a process can do to answer a frame on a pty: select, os.read, os.write.

`python -m benchmarks.bare PATH LENGTH` opens the pty and answers whatever it reads with the last LENGTH bytes of it, so
that the answer is as long as a drive frame and tells which sample it belongs to.  It is scheduled like the real host.
"""

import os
import select
import sys

from hil.running import realtime


def main(path: str, length: int) -> None:
    """Answer until the other end hangs up."""
    realtime.end_with_parent()
    line = os.open(path, os.O_RDWR | os.O_NOCTTY)
    realtime.prepare()
    watched = [line]
    while True:
        select.select(watched, (), ())
        try:
            os.write(line, os.read(line, 4096)[-length:])
        except OSError:  # EIO: the other end is closed
            return


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
