"""The bench service from Python, by the names of the library: `import hil.client`.

bench = hil.client.connect()  # the service of this folder; or connect(url, token)
run = bench.run("s-slow", link="pty:s-slow", duration_s=20)
run.verdict, run.angle.values
with bench.board("drift over night") as board:
    board.connect("serial:/dev/ttyACM0", "my.bench.toml")
    run = board.start(arm=True, duration_s=3600)
    for frame in bench.stream(["estimates.angle_rad"], window_s=60): ...
"""

from hil.client.service import Board, Service, connect
from hil.records.frame import Frame

__all__ = ["Board", "Frame", "Service", "connect"]
