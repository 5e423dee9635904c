"""What this machine holds on a link: the board latency, block or sample rate at which few enough answers are late.

From how late the answers of one record were (`hil.records.lateness`), whatever board it is of: the loop's rehearsal, a
run, or exchanges of time with a board that is not armed.
"""

import shlex
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from estimator.core.layout import MAX_LATENCY
from hil.bench import Bench
from hil.boards.emulation import is_emulated
from hil.records.lateness import Lateness
from hil.records.result import Holds
from hil.records.setting import Setting
from hil.wire.link_name import Emulated, parse_link
from hil.wire.spec import SPEC

MARGIN = 3.0
"""By which the expected share stays below its limit. A machine is not the same a minute later: runs of one board,
minutes apart on an idle machine, had 2.5 to 8.4 % late."""

_BLOCKS = 6  # that are tried at one rate
_PER_WATCHDOG = 4.0  # blocks that a watchdog waits for at least
_PER_CYCLE = 10.0  # samples of the vibration at least
_LARGEST_BLOCK = int(SPEC.registers["BLOCK"].maximum)


def held(late: Lateness, bench: Bench, own: Setting, *, after: Setting | None = None) -> Holds | None:
    """The first of the settings from `own` on, and behind `after`, whose late share is within [limits] late_fraction.

    Within it the expected share has to be by MARGIN, and the upper end of its interval. Where no setting is, the last
    one of which the upper end is; None where none is: then nothing holds but lockstep.
    """
    limit, best = bench.limits.late_fraction, None
    tried = list(settings(bench, own))
    for setting in tried[tried.index(after) + 1 if after in tried else 0 :]:
        share = late.share(setting.waits_s, bench.loop.duration_s, block=setting.block)
        if share.at_most <= limit:
            safely = MARGIN * share.expected <= limit
            best = Holds(**setting._asdict(), expected=share.expected, at_most=share.at_most, safely=safely)
            if best.safely:
                break
    return best


def settings(bench: Bench, own: Setting) -> Iterator[Setting]:
    """Settings that ask less and less of the machine, the first is `own`: latencies one by one up to what a host can
    queue, or larger blocks, then as many to the second at half the rate. Blocks are not longer in time than the largest
    at the own rate: a matrix that holds for longer follows the rotation no more."""
    if bench.loop.mode == "force":
        for latency in range(max(own.latency_ticks, 1), MAX_LATENCY + 1):
            yield own._replace(latency_ticks=latency, block=1)
        return
    resonance_Hz = bench.device.resonance_rad_s / (2.0 * np.pi)
    most = max(min(_LARGEST_BLOCK, int(bench.watchdog_s * own.rate_Hz / _PER_WATCHDOG)), own.block)
    blocks = np.unique(np.linspace(own.block, most, _BLOCKS).astype(int)).tolist()
    yield from (Setting(0, block, own.rate_Hz) for block in blocks)
    if 0.5 * own.rate_Hz >= _PER_CYCLE * resonance_Hz:
        yield from (Setting(0, block // 2, 0.5 * own.rate_Hz) for block in blocks if block >= 2)


def loop_changes(bench: Bench, setting: Setting) -> dict[str, int]:
    """Keys of [loop] that a setting changes: the block of gain mode, and with it a stride of the estimates that does
    not go with it."""
    loop = bench.loop
    if setting.latency_ticks or setting.block == loop.block:
        return {}
    fits = loop.estimate_every % setting.block == 0 or setting.block % loop.estimate_every == 0
    return {"block": setting.block} if fits else {"block": setting.block, "estimate_every": setting.block}


def own_setting(bench: Bench, latency_ticks: int) -> Setting:
    """Of the bench as run against a board of such a latency."""
    if bench.loop.mode == "gain":
        return Setting(0, bench.loop.block, bench.device.sample_rate_Hz)
    return Setting(max(latency_ticks, 1), 1, bench.device.sample_rate_Hz)


def advise(late: Lateness, bench: Bench, own: Setting, link: str, file: str) -> str | None:
    """What to do after a run of `own` with too many late answers: the command, or what to change before it; None where
    no setting beyond `own` holds."""
    found = held(late, bench, own, after=own)
    if found is None:
        return None
    setting, again = found.setting, f"hil run {file} --link"
    changes = [f"[loop] {key} = {value}" for key, value in loop_changes(bench, setting).items()]
    if setting.rate_Hz != own.rate_Hz:
        changes.append(f"[device] sample_rate_Hz = {setting.rate_Hz:g}")
    before = f"{' and '.join(changes)} in {file}, then " if changes else ""
    if is_emulated(link) and isinstance(board := parse_link(link), Emulated):
        if setting.latency_ticks:
            board = replace(board, latency_ticks=setting.latency_ticks)
        elif setting.rate_Hz != own.rate_Hz:
            board = replace(board, rate_Hz=setting.rate_Hz)
        return f"{before}{again} {shlex.quote(board.url)}"
    if setting.latency_ticks:
        before = f"a latency of {setting.latency_ticks} ticks in the board's firmware (hil emulate --latency), then "
    elif setting.rate_Hz != own.rate_Hz:
        before = f"a board at {setting.rate_Hz:g} Hz (hil emulate --rate), {before}"
    return f"{before}{again} {shlex.quote(link)}"
