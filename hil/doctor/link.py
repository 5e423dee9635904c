"""One link: opened, asked, measured, judged."""

import json
import math
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from hil.boards.emulation import is_emulated, served
from hil.doctor import machine
from hil.doctor.machine import Finding
from hil.errors import InputError
from hil.running.process import line_workers
from hil.wire.can_format import ROOM
from hil.wire.errors import WireError
from hil.wire.link_name import CanInterface, SerialPort, parse_link
from hil.wire.messages import Capabilities
from hil.wire.spec import SPEC

CORE = 0.5
"""Share of one core that gain mode may take: the rest of it is for what a shared machine does now and then."""

PATH = 1.2
"""What a sample costs the host from the wire to the record, in what it costs the observer: 1.08 at 100 kS/s."""

_ROW_BYTES = 8.0  # four codes of 16 bits
_FRAMING = 1.08  # headers, checksums and stuffing of blocks of 250 rows
_UART_BITS = 10.0
# A CAN FD frame of 64 bytes: about 30 bits at the arbitration rate, 64 bytes with checksum and stuffing at the other.
_ARBITRATION_BITS, _DATA_BITS = 30.0, 600.0


LATENCIES = 1, 4
"""Of boards in force mode of which it is told what rate they can have."""

LARGEST_BLOCK = int(SPEC.registers["BLOCK"].maximum)


class Capacity(NamedTuple):
    """Rates in samples a second. `limit` says what the lower one depends on."""

    force_Hz: float
    force_limit: str
    gain_Hz: float
    gain_limit: str


def holds(probed: dict[str, Any], held: Capacity) -> list[tuple[str, str, str]]:
    """What the machine holds on that link, a row each: mode, setting of the board, and what it may be."""
    tick, rate_Hz = probed["tick_us"], float(probed["identity"]["tick_rate_Hz"])
    rows = []
    answer_us = probed["round_trip_us"]["p99"] + tick["p99"]
    core_Hz = CORE * 1e6 / (PATH * (probed["busy_us"] + tick["p50"]))
    for latency in LATENCIES:
        most = min(latency * 1e6 / answer_us, core_Hz)
        setting = f"latency {latency} tick{'s' if latency > 1 else ''}"
        rows.append(("force", setting, f"up to {rounded(most):g} Hz"))
    rows.append(("gain", "any block", f"up to {rounded(held.gain_Hz):g} Hz"))
    block = least_block(probed["round_trip_us"]["p99"], PATH * probed["block_us_per_row"], rate_Hz)
    few = f"blocks of {block} samples or more" if block else "no block is long enough"
    rows.append(("gain", f"{rate_Hz:g} Hz", few))
    return rows


def least_block(round_trip_us: float, row_us: float, rate_Hz: float) -> int | None:
    """The smallest block within whose length a block comes, is observed at `row_us` a sample, and is answered; None
    where none is.

    >>> least_block(100.0, 4.0, 1e5), least_block(100.0, 11.0, 1e5)
    (17, None)
    """
    spare_us = 1e6 / rate_Hz - row_us
    block = math.ceil(round_trip_us / spare_us) if spare_us > 0.0 else LARGEST_BLOCK + 1
    return block if block <= LARGEST_BLOCK else None


def rounded(rate_Hz: float) -> float:
    """Two significant digits, downward: nobody should plan with the rest."""
    scale = 10.0 ** (len(str(int(rate_Hz))) - 2)
    return int(rate_Hz / scale) * scale


def capacity(
    probed: dict[str, Any], *, baud: float | None = None, bit_rates: tuple[float, float] | None = None
) -> Capacity:
    """What `hil.doctor.probe` measured, on a UART of `baud`, or on CAN with (arbitration, data) `bit_rates`."""
    tick, row = probed["tick_us"], probed["block_us_per_row"]
    round_trip, own = probed["round_trip_us"]["p99"], tick["p99"]
    latency = max(int(probed["identity"]["latency_ticks"]), 1)
    force_Hz = latency * 1e6 / (round_trip + own)
    force_limit = f"round trip {round_trip:.0f} µs and observer {own:.0f} µs, p99, within {latency} sample"
    force_limit += "s" if latency > 1 else ""
    gain_Hz = CORE * 1e6 / (PATH * row)
    gain_limit = f"the observer takes {row:.2g} µs a sample, the host {PATH:g} times that, {CORE:.0%} of a core"
    wire = wire_rate_Hz(baud, bit_rates)
    if wire < gain_Hz:
        gain_Hz, gain_limit = wire, "what the wire carries"
    return Capacity(force_Hz, force_limit, gain_Hz, gain_limit)


def wire_rate_Hz(baud: float | None, bit_rates: tuple[float, float] | None) -> float:
    """Samples of four 16-bit codes a second that fit on the wire; infinite where it sets no limit."""
    if baud is not None:
        return baud / _UART_BITS / (_ROW_BYTES * _FRAMING)
    if bit_rates is not None:
        slow, fast = bit_rates
        return (ROOM // _ROW_BYTES) / (_ARBITRATION_BITS / slow + _DATA_BITS / fast)
    return math.inf


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
    return machine.bit_rates(bus.channel) if isinstance(bus, CanInterface) else None
