"""What is looked at before a board is armed, in a dry run too: each check refuses in one line.

`require_plausible` looks at IDENTITY alone, `require_suitable` at it beside the bench file, `configure` writes the
registers and reads them back, `require_clock` asks the board for its time.  What only samples tell is in
`hil.running.safety.opening`.
"""

import math
import secrets
import time
from collections.abc import Mapping
from pathlib import Path

from estimator.core.layout import MAX_LATENCY
from hil.bench import Bench
from hil.bench.angle_map import read_angle_map
from hil.bench.plausible import FASTEST_HZ, LARGEST_V
from hil.errors import InputError
from hil.inputs.declared import board_dither_of, board_filter_of, drive_limit_of, require_agreement
from hil.running.safety.asked_again import differs
from hil.wire import client
from hil.wire.endpoint import Endpoint
from hil.wire.errors import ProtocolError
from hil.wire.messages import Capabilities, ClockMode, Identity, LoopMode
from hil.wire.spec import SPEC

_BITS = 2, 24  # a code is a signed number of at most 24 bits
_AXES = 1, 2
# Far outside what any board has: they catch a slipped exponent, or a field that was never filled in.
_SCALES = {
    "tick_rate_Hz": (1e-3, FASTEST_HZ, "hertz"),
    "sense_scale_V": (1e-15, LARGEST_V, "volts a code"),
    "drive_scale_mps2": (1e-15, 1e6, "m/s² a code"),
}
_LEAST_CODES = 2.0  # of the converter that the declared amplitude has to move
_CLOCK_S = 0.05  # between two questions about the board's time
_PACE = 0.9, 1.1  # of a board's clock beside this host's: far beyond any oscillator, well within what is another unit


def require_plausible(identity: Identity, link: str) -> None:
    """InputError naming the first field of IDENTITY that no board can have."""
    for name, (least, most, unit) in _SCALES.items():
        value = getattr(identity, name)
        if not (math.isfinite(value) and value > 0.0):
            raise InputError(f"{link}: IDENTITY.{name} is {value:g}, must be finite and positive; correct the firmware")
        if not least <= value <= most:
            raise InputError(
                f"{link}: IDENTITY.{name} is {value:g}, no board has that: it counts {unit}; correct the firmware"
            )
    for name, (fewest, greatest) in {"sense_bits": _BITS, "drive_bits": _BITS, "axes": _AXES}.items():
        value = getattr(identity, name)
        if not fewest <= value <= greatest:
            raise InputError(
                f"{link}: IDENTITY.{name} is {value}, must be {fewest} to {greatest}; correct the firmware"
            )
    if identity.latency_ticks > MAX_LATENCY:
        raise InputError(
            f"{link}: IDENTITY.latency_ticks is {identity.latency_ticks}, this host can queue {MAX_LATENCY}; "
            "correct the firmware, or answer sooner"
        )


def require_undone(bench: Bench) -> None:
    """InputError for an effect whose force depends on the way that the mass came: in the loop the observer does not
    carry its past on, and would make the angle worse (docs/decisions/0009-effects.md).
    """
    if not bench.effects.named:
        return
    from estimator.effects.catalogue import EFFECTS  # loads SymPy

    of_the_way = {effect.name for effect in EFFECTS if effect.slips}
    for name in bench.effects.named:
        if name.partition(":")[0] in of_the_way:
            raise InputError(
                f"[effects.{name}]: no control law compensates it yet; leave it out, and trace a record of a "
                f"single axis with `hil trace`"
            )


def require_suitable(bench: Bench, identity: Identity, link: str) -> None:
    """InputError naming the first thing that bench file and board do not agree on, or that the board cannot do."""
    require_plausible(identity, link)
    require_agreement(bench, identity, link)
    _require_own_map(bench, identity, link)
    able = Capabilities(identity.capabilities)
    clock = ClockMode[bench.loop.clock.upper()]
    if not able & (Capabilities.FORCE_MODE | Capabilities.GAIN_MODE | Capabilities.BOARD_MODE):
        raise InputError(
            f"{link}: IDENTITY.capabilities is {identity.capabilities}, neither force nor gain mode, nor an estimator: "
            "nothing could be driven; correct the firmware"
        )
    if (kept := clock_kept(able, clock)) is not clock:
        refused, offered = clock.name.lower(), kept.name.lower()
        raise InputError(f'{link}: the board does not offer clock = "{refused}"; use [loop] clock = "{offered}"')
    if bench.loop.mode == "gain" and Capabilities.GAIN_MODE not in able:
        raise InputError(f'{link}: the board cannot close the loop itself; use [loop] mode = "force"')
    if bench.loop.mode == "board" and Capabilities.BOARD_MODE not in able:
        other = "force" if Capabilities.FORCE_MODE in able else "gain"
        raise InputError(f'{link}: the board has no estimator of its own; use [loop] mode = "{other}"')
    if bench.loop.mode == "force" and Capabilities.FORCE_MODE not in able:
        raise InputError(f'{link}: the board does not take a drive for each sample; use [loop] mode = "gain"')
    _require_range(bench, identity, link)


def clock_kept(able: Capabilities, asked: ClockMode) -> ClockMode:
    """The clock asked for where the board keeps it, else one that it keeps, as far as IDENTITY tells.

    PACED is kept by emulated boards, REAL by hardware, so a board keeps one of the two (docs/wire.md, Clock modes); an
    emulated board inside the host's process keeps LOCKSTEP only.
    """
    if asked is ClockMode.LOCKSTEP:
        if Capabilities.LOCKSTEP in able:
            return asked
        return ClockMode.PACED if Capabilities.PACED in able else ClockMode.REAL
    if Capabilities.PACED in able:
        return ClockMode.PACED
    if asked is ClockMode.PACED:
        return ClockMode.LOCKSTEP if Capabilities.LOCKSTEP in able else ClockMode.REAL
    return asked


def _require_own_map(bench: Bench, identity: Identity, link: str) -> None:
    """InputError where the angle map is another device's."""
    if (file := bench.device.calibration.angle_map) is None:
        return
    known, serial = read_angle_map(Path(file)).serial_number, f"{identity.unique_id:016x}"
    if known != serial:
        raise InputError(
            f"{link}: the board's serial number is {serial}, and {file} is of {known}; give its own "
            "[device.calibration] angle_map, or leave it out"
        )


def _require_range(bench: Bench, identity: Identity, link: str) -> None:
    """The declared motion has to fit into the sense converter, and the declared drive to move a code."""
    full_V = identity.sense_scale_V * 2 ** (identity.sense_bits - 1)
    for axis, swing_V in zip("xy", bench.swing_V, strict=False):
        told = f"[device] amplitude_m × [device.sense] gain_V_per_m is {swing_V:.3g} V on {axis}"
        if swing_V > full_V:
            raise InputError(
                f"{link}: {told}, the board's converter ends at ± {full_V:.3g} V; correct gain or amplitude"
            )
        if swing_V < _LEAST_CODES * identity.sense_scale_V:
            raise InputError(
                f"{link}: {told}, a code of the board's converter {identity.sense_scale_V:.3g} V: "
                "nothing could be measured; correct gain or amplitude"
            )
    if bench.controller.enabled and drive_limit_of(bench, identity) < 1:
        raise InputError(
            f"{link}: the largest drive declared is less than one code, {identity.drive_scale_mps2:.3g} m/s²; "
            "correct [device.drive] full_scale"
        )
    dither = bench.controller.dither_mps2
    if bench.loop.mode == "gain" and bench.controller.enabled and dither and not board_dither_of(bench, identity)[0]:
        raise InputError(
            f"{link}: [controller] dither_mps2 is {dither:g} m/s², a drive code {identity.drive_scale_mps2:.3g} m/s²: "
            "the board would add nothing; give a code at least, or 0"
        )


def configure(endpoint: Endpoint, identity: Identity, bench: Bench) -> dict[str, float]:
    """Clock, watchdog, limits, in gain mode filter and dither, in board mode the stride of its estimates, and a session
    number into the board's registers; what they hold now, read back.

    Raises ProtocolError where a register does not read back as written, and as `client.request`.
    """
    gain_mode = bench.loop.mode == "gain"
    estimates = bench.loop.mode == "board" and Capabilities.ESTIMATE in Capabilities(identity.capabilities)
    registers: dict[str, float] = {
        "CLOCK_MODE": ClockMode[bench.loop.clock.upper()],
        "LOOP_MODE": LoopMode[bench.loop.mode.upper()],
        "BLOCK": bench.loop.rows,
        "WATCHDOG_TICKS": max(math.ceil(bench.watchdog_s * identity.tick_rate_Hz), 2),
        "DRIVE_LIMIT": drive_limit_of(bench, identity),
    }
    if gain_mode:
        board = board_filter_of(bench)
        registers |= {f"FILTER_A{i + 1}{j + 1}": board.a[i][j] for i in range(2) for j in range(2)}
        registers |= {f"FILTER_B{i + 1}": board.b[i] for i in range(2)}
        registers |= {f"FILTER_C{i + 1}": board.c[i] for i in range(2)}
        registers |= {"FILTER_DELAY": board.delay}
        registers |= dict(zip(("DITHER_AMPLITUDE", "DITHER_SEED"), board_dither_of(bench, identity), strict=True))
    if estimates:
        registers["ESTIMATE_EVERY"] = bench.loop.estimate_every
    if "SESSION" in SPEC.registers:
        registers["SESSION"] = 1 + secrets.randbelow(0xFFFFFFFF)
    for name, value in registers.items():
        try:
            client.write_register(endpoint, name, value, bench.link.timeout_s)
        except ProtocolError as error:
            if name == "CLOCK_MODE" and Capabilities.LOCKSTEP in Capabilities(identity.capabilities):
                raise ProtocolError(f'{error}; use [loop] clock = "lockstep"') from None
            raise
    for name, value in registers.items():  # all of them again: writing one may have changed another
        held = client.read_register(endpoint, name, bench.link.timeout_s)
        if held != value:
            raise ProtocolError(
                f"{endpoint.link.name}: {name} reads {held:.10g} after {value:.10g} was written; correct the firmware"
            )
    return registers


def require_unchanged(endpoint: Endpoint, registers: Mapping[str, float], timeout_s: float) -> None:
    """ProtocolError when SESSION, or any other register, no longer reads as written; before a board is armed again."""
    for name in sorted(registers, key=lambda name: name != "SESSION"):
        held = client.read_register(endpoint, name, timeout_s)
        if held != registers[name]:
            raise ProtocolError(
                f"{endpoint.link.name}: {differs(name, held, registers[name])}", "check the board's supply"
            )


def require_clock(endpoint: Endpoint) -> None:
    """ProtocolError when a board on wall time says the time, and that stands still or runs like no clock.

    A board that does not answer has none to say: then the record is not related to this host's clock.
    """
    first, second = _ask_time(endpoint), None
    if first is not None:
        time.sleep(_CLOCK_S)
        second = _ask_time(endpoint)
    if first is None or second is None:
        return
    ours, theirs = second[0] - first[0], second[1] - first[1]
    uncertain = first[2] + second[2]  # ns of the round trips, within which each answer may have been given
    if not _PACE[0] * (ours - uncertain) <= theirs <= _PACE[1] * (ours + uncertain):
        raise ProtocolError(
            f"{endpoint.link.name}: the board's clock went on by {1e-9 * theirs:.3g} s in {1e-9 * ours:.3g} s; "
            "correct its TIME_SYNC, which is in ns"
        )


def _ask_time(endpoint: Endpoint) -> tuple[int, int, int] | None:
    """(host clock in the middle, board clock, round trip) in ns, None without an answer."""
    endpoint.exchanges.clear()
    asked = endpoint.ask_time()
    end = time.monotonic() + 2.0 * _CLOCK_S
    while (left := end - time.monotonic()) > 0.0:
        endpoint.keep(endpoint.poll_new(left))
        for sent_ns, board_ns, received_ns, _ in endpoint.exchanges:
            if sent_ns == asked:
                endpoint.exchanges.clear()
                return (sent_ns + received_ns) // 2, board_ns, received_ns - sent_ns
    return None
