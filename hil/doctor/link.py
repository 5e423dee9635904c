"""One link: opened, asked, measured, judged."""

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from hil.boards.emulation import is_emulated, served
from hil.doctor import ports
from hil.doctor.capacity import Capacity, capacity, holds, rounded
from hil.doctor.finding import Finding
from hil.errors import InputError
from hil.running import line_workers
from hil.wire.errors import WireError
from hil.wire.link_name import CanInterface, SerialPort, parse_link
from hil.wire.messages import Capabilities


def examine(link: str) -> tuple[list[Finding], dict[str, Any] | None]:
    """Findings about the link, and what was measured; None where nobody answered. Arms emulated boards only."""
    try:
        with served(link) as there, line_workers.ahead(there.url):  # as in a run
            said = subprocess.run(
                [sys.executable, "-m", "hil.doctor.probe", there.url, *(["--stream"] if is_emulated(link) else [])],
                stdout=subprocess.PIPE,
                text=True,
                check=False,
            )
    except (InputError, WireError) as error:
        return [Finding("link", "bad", str(error))], None
    if not said.stdout.strip():
        return [Finding("link", "bad", f"the measurement ended with code {said.returncode}")], None
    probed: dict[str, Any] = json.loads(said.stdout)
    if "error" in probed:
        told, _, remedy = str(probed["error"]).removeprefix(f"{link}: ").partition(": sudo ")
        return [Finding("link", "bad", told, f"sudo {remedy}" if remedy else "")], None
    held = capacity(probed, baud=uart_baud(link), bit_rates=_bit_rates(link))
    probed["force_Hz"], probed["gain_Hz"] = held.force_Hz, held.gain_Hz
    probed["holds"] = holds(probed, held)
    return list(judge(link, probed, held)), probed


def judge(link: str, probed: dict[str, Any], held: Capacity) -> Iterator[Finding]:
    """What the measurement means for this board."""
    identity, trip, nap = probed["identity"], probed["round_trip_us"], probed["wake_up_us"]
    rate, able = float(identity["tick_rate_Hz"]), Capabilities(identity["capabilities"])
    yield Finding("link", "good", f"board {identity['unique_id']:016x} answers; it samples at {rate:g} Hz")
    if outputs := [
        f"{one['name']} {one['lowest'] * one['scale_V']:.4g} to {one['highest'] * one['scale_V']:.4g} V, settles in "
        f"{1e3 * one['settling_s']:.3g} ms"
        for one in probed.get("trims", ())
    ]:
        yield Finding("trim outputs", "good", "; ".join(outputs))
    for refused in probed["refused"]:
        yield Finding("this measurement", "missing", refused)
    yield Finding(
        "round trip", "good", f"p50 {trip['p50']:.0f} µs, p99 {trip['p99']:.0f} µs, worst {trip['max']:.0f} µs"
    )
    yield Finding(
        "wake-up delay", "good", f"p50 {nap['p50']:.0f} µs, p99 {nap['p99']:.0f} µs, worst {nap['max']:.0f} µs"
    )
    for mode, bit, held_Hz, limit in (
        ("force mode", Capabilities.FORCE_MODE, held.force_Hz, held.force_limit),
        ("gain mode", Capabilities.GAIN_MODE, held.gain_Hz, held.gain_limit),
    ):
        told = f"up to {rounded(held_Hz):g} Hz ({limit})"
        if bit not in able:
            yield Finding(mode, "missing", f"{told}; the board does not offer it")
        elif held_Hz < rate:
            remedy = (
                "use a larger latency in its firmware (hil emulate --latency)"
                if mode == "force mode"
                else "use a faster wire, or a lower sample rate"
            )
            if mode == "force mode" and Capabilities.GAIN_MODE in able:
                remedy += ', or [loop] mode = "gain"'
            yield Finding(mode, "missing", f"{told}; too slow for this board", remedy)
        else:
            yield Finding(mode, "good", told)


def uart_baud(link: str) -> float | None:
    """Baud rate of a real UART; None of ptys, of USB devices that have none, and of other links."""
    port = parse_link(link)
    if (
        not isinstance(port, SerialPort)
        or port.path.startswith("/dev/pts/")
        or Path(port.path).name.startswith("ttyACM")
    ):
        return None
    return float(port.baud)


def _bit_rates(link: str) -> tuple[float, float] | None:
    bus = parse_link(link)
    return ports.bit_rates(bus.channel) if isinstance(bus, CanInterface) else None
