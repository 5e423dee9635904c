"""A commercial gyro that is recorded beside a run, in a process of its own: `python -m hil.sensors.beside LINK FILE`.

It says in one JSON line that the sensor speaks, or why not; then it records until its standard input ends, as it does
when the run is over or its process has died, and says in a second line what came of it.
"""

import json
import os
import select
import signal
import sys
from contextlib import closing
from pathlib import Path

from hil.errors import InputError
from hil.records.capture import read_capture
from hil.records.rates import sensor_figures
from hil.records.stream import BlockWriter
from hil.sensors.port import find_port, open_source, recognised
from hil.sensors.record import Stream, counters_of
from hil.wire.errors import WireError

_NICE = 5  # behind everything that the loop needs


def main(link: str, file: Path) -> int:
    """Until standard input ends; returns the exit code."""
    os.nice(_NICE)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        port = find_port(link)
        if port.adapter is None:
            port = recognised(port, link)
        assert port.adapter is not None
        with closing(open_source(port)) as source:
            stream = Stream(port, source, stamped=True)
            stream.begin(link)
            layout = stream.layout()
            _say({"device": port.adapter.title, "channels": [column.name for column in port.adapter.channels]})
            with BlockWriter(file, layout) as writer:
                stopped = stream.follow(writer, _is_over)
        capture = read_capture(file)
        sensor = sensor_figures(capture, port.adapter.complaints, host_rate_Hz=stream.host_rate_Hz())
    except (InputError, WireError) as error:
        _say({"error": str(error)})
        return 2
    _say(
        {
            "stopped": stopped,
            "samples": len(capture),
            "lost": capture.lost,
            "counters": counters_of(port.adapter, stream),
            "silent_s": stream.longest_silence_s,
            "sensor": sensor.model_dump(mode="json"),
        }
    )
    return 0


def _is_over() -> bool:
    ready, _, _ = select.select([0], (), (), 0.0)
    return bool(ready)


def _say(line: dict[str, object]) -> None:
    os.write(1, json.dumps(line).encode() + b"\n")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], Path(sys.argv[2])))
