"""`python -m benchmarks.service_pages URL TOKEN PAGES`: what so many open pages ask of a service, until its input ends.

Each has what the page shows: the pattern, a scope over both axes, the innovation over ten seconds, two spectra, and the
state.  At the end one JSON line: frames a second of the scope, per page, and the cores that the pages took together.
"""

import asyncio
import json
import sys
import time

from websockets.asyncio.client import connect

ASKED = (
    {"op": "pattern", "id": 1, "periods": 3},
    {"op": "subscribe", "id": 2, "channels": ["capture.vx_V", "capture.vy_V"], "window_s": 0.02, "points": 800},
    {"op": "subscribe", "id": 3, "channels": ["innovation.nu_x_V", "innovation.nu_y_V"], "window_s": 10, "points": 400},
    {"op": "spectrum", "id": 4, "channel": "innovation.nu_x_V"},
    {"op": "spectrum", "id": 5, "channel": "innovation.nu_y_V"},
)


async def page(url: str, token: str, came: list[float]) -> None:
    """One page; notes when frames of the scope came."""
    async with connect(f"ws{url.removeprefix('http')}api/live", max_size=None) as socket:
        await socket.send(json.dumps({"op": "hello", "token": token}))
        for asked in ASKED:
            await socket.send(json.dumps(asked))
        async for data in socket:
            if isinstance(data, bytes) and data[4] == 2:
                came += [time.monotonic()]


async def main() -> None:
    """All of them."""
    url, token, pages = sys.argv[1], sys.argv[2], int(sys.argv[3])
    came: list[list[float]] = [[] for _ in range(pages)]
    tasks = [asyncio.ensure_future(page(url, token, of_page)) for of_page in came]
    begin, busy = time.monotonic(), time.process_time()
    await asyncio.get_running_loop().run_in_executor(None, sys.stdin.read)
    cores = (time.process_time() - busy) / (time.monotonic() - begin)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    rates = [(len(times) - 1) / (times[-1] - times[0]) for times in came if len(times) > 1]
    print(json.dumps({"frames": rates, "cores": cores}), flush=True)


asyncio.run(main())
