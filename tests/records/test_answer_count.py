"""The count of answers reads timing and capture side by side: it must not matter in which pieces, or that it does."""

import numpy as np
import pytest

import hil.records.blocks
from hil.records.capture import RowFlag
from hil.records.layout import Layout
from hil.records.stream import BlockWriter
from hil.records.summary import count_answers
from hil.records.timing import Timing, ledger_layout, timing_layout

LATENCY, BLOCK, TICKS = 2, 20, 5000


def written(path, layout: Layout, columns: dict[str, np.ndarray]) -> Timing:
    rows = np.zeros(len(columns["tick"]), layout.dtype)
    for name, values in columns.items():
        rows[name] = values
    with BlockWriter(path, layout) as writer:
        writer.push(rows)
    return Timing.read(path)


def by_hand(ticks, flags, sent, elapsed_us, applied, deadline_us, gain):
    """(answered, not in time, slow), sample by sample."""
    recorded = dict(zip(ticks.tolist(), flags.tolist(), strict=True))
    block, counts = BLOCK if gain else 1, [0, 0, 0]
    for number, tick in enumerate(sent.tolist()):
        begin = max(tick - block, int(sent[number - 1]) if number else -1)
        samples = sum(one in recorded for one in range(begin + 1, tick + 1))
        if gain:
            missed = tick + block in recorded and applied[number] != tick + block
        else:
            missed = bool(recorded.get(tick + LATENCY + 1, 0) & RowFlag.LATE_ANSWER_HELD)
        counts[0] += samples
        counts[1] += samples * missed
        counts[2] += samples * bool(elapsed_us[number] > deadline_us)
    return counts


@pytest.mark.moderate
@pytest.mark.parametrize("gain", [False, True])
@pytest.mark.parametrize(("piece", "rows_a_piece"), [(1 << 18, 5000), (64, 7), (7, 64), (1, 333), (333, 1)])
def test_the_pieces_do_not_matter(tmp_path, monkeypatch, gain, piece, rows_a_piece):
    rng = np.random.default_rng(20261122)
    ticks = np.flatnonzero(rng.random(TICKS) > 0.05)
    flags = np.where(rng.random(ticks.size) < 0.1, int(RowFlag.LATE_ANSWER_HELD), 0).astype(np.uint8)
    sent = np.arange(BLOCK - 1, TICKS, BLOCK) if gain else ticks
    sent = sent[rng.random(sent.size) > 0.1]
    elapsed_us = rng.uniform(0.0, 300.0, sent.size).round()
    columns = {"tick": sent, "t_receive_ns": 10**9, "t_send_ns": 10**9 + (1e3 * elapsed_us).astype(np.int64)}
    applied = sent + BLOCK + rng.choice([0, 0, BLOCK], sent.size)
    if gain:
        layout = ledger_layout(tick_rate_Hz=4000.0, block=BLOCK, deadline_us=250.0)
        columns["applied_tick"] = applied
    else:
        layout = timing_layout(tick_rate_Hz=4000.0, deadline_us=250.0)
    timing = written(tmp_path / "timing.arrow", layout, columns)
    monkeypatch.setattr(hil.records.blocks.pieces_of, "__defaults__", (piece,))
    pieces = [
        (ticks[at : at + rows_a_piece], flags[at : at + rows_a_piece]) for at in range(0, ticks.size, rows_a_piece)
    ]
    counted = count_answers(iter(pieces), timing, LATENCY)
    answered, not_in_time, slow = by_hand(ticks, flags, sent, elapsed_us, applied, 250.0, gain)
    assert (counted.in_time, counted.late, counted.slow) == (answered - not_in_time, not_in_time, slow)
    assert counted.unanswered == ticks.size - answered
