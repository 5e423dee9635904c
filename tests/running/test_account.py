"""What accounts for a stop and what does not: docs/safety.md, rule 6; docs/decisions/0002-arming-and-latching.md."""

from collections.abc import Iterator

import pytest

from hil.running.safety.armed import Account
from hil.wire.endpoint import Endpoint
from hil.wire.messages import SafeReason, State
from hil.wire.serial_format import SERIAL
from hil.wire.spec import SPEC
from tests.running.on_a_pty import Far, arrived, connected, rows, status

WATCHDOG, RATE_HZ = 200, 400.0
WATCHDOG_NS = round(1e9 * WATCHDOG / RATE_HZ)
ARMED = status(State.ARMED, SafeReason.NONE, lost_seq=7, bad_frames=5)
"""The board's counts are since its power-up: what they were at ARM speaks for nothing."""
STOPPED = ARMED._replace(state=State.SAFE, reason=SafeReason.WATCHDOG)


@pytest.fixture
def ends() -> Iterator[tuple[Endpoint, Far]]:
    with connected() as both:
        yield both


def account(host: Endpoint, block: int = 1) -> Account:
    kept = Account(host, WATCHDOG, block, RATE_HZ, latency=1)
    kept.begin(ARMED)
    return kept


def lose(host: Endpoint, far: Far, frames: int) -> None:
    """Two rows, between which so many frames are lost."""
    far.say(rows((0, 0)))
    far.lose(frames)
    far.say(rows((0, 0)))
    arrived(host, 2)


def damage(host: Endpoint, far: Far) -> None:
    """A row whose checksum is not its own, and one that is whole."""
    frame = bytearray(far.tx.encode(rows((0, 0)), 0))
    far.tx.seq -= 1
    frame[len(frame) // 2] ^= 0x40
    far.say_bytes(bytes(frame))
    far.say(rows((0, 0)))
    arrived(host, 1)


def contradict(host: Endpoint, far: Far) -> None:
    """An intact SPEC.messages["SENSE"].type of no rows, and one of a row."""
    empty = SERIAL.encode(SPEC.messages["SENSE"].type, far.tx.seq, 0, b"\0\0\2\0\0")[0]
    far.tx.seq += 1
    far.say_bytes(empty)
    far.say(rows((0, 0)))
    arrived(host, 1)


def test_nothing_accounts_for_a_stop_of_which_this_host_knows_nothing(ends: tuple[Endpoint, Far]) -> None:
    kept = account(ends[0])
    assert kept.of_watchdog(STOPPED) == ""
    assert kept.of_silence(STOPPED) == ""
    assert kept.of_silence(None) == ""
    assert "never late" in kept.words
    assert "watchdog 0.5 s" in kept.words


def test_a_host_that_was_silent_for_the_watchdog_accounts_for_it(ends: tuple[Endpoint, Far]) -> None:
    kept = account(ends[0])
    kept.silent(WATCHDOG_NS)
    kept.silent(1)  # the longest of its silences counts
    assert kept.of_watchdog(STOPPED) == "this host sent nothing for 0.5 s"
    assert kept.of_silence(STOPPED) == ""  # docs/decisions/0002-arming-and-latching.md: silence is not loss


@pytest.mark.parametrize("block", [1, 60])
def test_a_much_shorter_silence_does_not(ends: tuple[Endpoint, Far], block: int) -> None:
    kept = account(ends[0], block)
    for _ in range(3):
        kept.silent(int(0.45 * WATCHDOG_NS))  # neither one of them nor all together
    assert kept.of_watchdog(STOPPED) == ""
    assert "never silent for longer than 0.225 s" in kept.words


def test_in_blocks_a_silence_is_known_to_a_block_at_either_end(ends: tuple[Endpoint, Far]) -> None:
    """The board counts ticks between two drives that came, the host what passed between two answers."""
    kept = account(ends[0], 20)
    kept.silent(round(0.82 * WATCHDOG_NS))
    assert kept.of_watchdog(STOPPED) != ""
    kept.begin(ARMED)
    kept.silent(round(0.75 * WATCHDOG_NS))
    assert kept.of_watchdog(STOPPED) == ""


def test_a_short_watchdog_is_accounted_for_by_nothing_either(ends: tuple[Endpoint, Far]) -> None:
    kept = Account(ends[0], 3, 1, RATE_HZ, latency=2)
    kept.begin(ARMED)
    assert kept.of_watchdog(STOPPED) == ""
    kept.held = 1, 1, 78
    assert kept.of_watchdog(STOPPED) == "answers were late on 1 ticks running"
    kept.held = 2, 2, 81
    assert kept.of_watchdog(STOPPED) == "answers were late on 2 ticks running"


def test_a_time_worth_telling_is_about_the_watchdog(ends: tuple[Endpoint, Far]) -> None:
    for block in (1, 60):
        kept = account(ends[0], block)
        assert 0.5 * WATCHDOG_NS <= kept.suspicious_ns <= WATCHDOG_NS
        kept.silent(kept.suspicious_ns - 1)
        assert kept.of_watchdog(STOPPED) == ""
        kept.silent(kept.suspicious_ns)
        assert kept.of_watchdog(STOPPED) != ""


def test_a_silence_from_before_arm_does_not_count(ends: tuple[Endpoint, Far]) -> None:
    kept = account(ends[0])
    kept.silent(WATCHDOG_NS)
    kept.held = WATCHDOG, WATCHDOG, WATCHDOG
    kept.begin(ARMED)
    assert kept.of_watchdog(STOPPED) == ""


def test_drives_that_came_late_for_as_long_account_for_it(ends: tuple[Endpoint, Far]) -> None:
    kept = account(ends[0])
    kept.held = WATCHDOG, 1, 2001  # the longest run counts
    assert kept.of_watchdog(STOPPED) == f"answers were late on {WATCHDOG} ticks running"
    assert kept.of_silence(STOPPED) == ""


def test_drives_that_came_late_for_half_as_long_do_not(ends: tuple[Endpoint, Far]) -> None:
    kept = account(ends[0])
    kept.held = WATCHDOG // 2, 1, 3000
    assert kept.of_watchdog(STOPPED) == ""


@pytest.mark.parametrize("latency", [1, 4])
def test_rows_lost_to_watchdog_or_latency_are_not_asked_for(ends: tuple[Endpoint, Far], latency: int) -> None:
    """The interval of the last drive, the one in which the watchdog tripped, and those before a drive acts."""
    kept = Account(ends[0], WATCHDOG, 1, RATE_HZ, latency)
    kept.begin(ARMED)
    late = WATCHDOG - 3 - latency
    kept.held = late, late, late
    assert kept.of_watchdog(STOPPED) == ""
    kept.held = late + 1, late + 1, late + 1
    assert kept.of_watchdog(STOPPED) == f"answers were late on {WATCHDOG - 2 - latency} ticks running"


def test_frames_that_were_lost_account_for_both(ends: tuple[Endpoint, Far]) -> None:
    host, far = ends
    kept = account(host)
    lose(host, far, 3)
    damage(host, far)
    words = "4 frames to the host and 0 to the board were lost or damaged"
    assert kept.of_watchdog(STOPPED) == kept.of_silence(STOPPED) == kept.of_silence(None) == words


@pytest.mark.parametrize("what", [lose, damage])
def test_one_frame_is_enough_and_none_from_before_arm(ends: tuple[Endpoint, Far], what) -> None:
    kept = account(ends[0])
    what(*ends, *([1] if what is lose else []))
    assert kept.of_silence(STOPPED).startswith("1 frames to the host and 0 to the board")
    kept.begin(ARMED)
    assert kept.of_silence(STOPPED) == ""


@pytest.mark.parametrize(("count", "more"), [("lost_seq", 2), ("bad_frames", 3)])
def test_frames_that_the_board_missed_since_arm_account_for_both(
    ends: tuple[Endpoint, Far], count: str, more: int
) -> None:
    kept = account(ends[0])
    said = STOPPED._replace(**{count: getattr(ARMED, count) + more})
    words = f"0 frames to the host and {more} to the board were lost or damaged"
    assert kept.of_watchdog(said) == kept.of_silence(said) == words


def test_a_board_that_counts_from_zero_again_has_missed_nothing(ends: tuple[Endpoint, Far]) -> None:
    kept = account(ends[0])
    assert kept.of_silence(STOPPED._replace(lost_seq=0, bad_frames=1)) == ""


def test_a_frame_that_contradicts_itself_is_no_damage(
    ends: tuple[Endpoint, Far],
) -> None:
    """A host that was silent because the frames it got were unacceptable has seen no cause."""
    kept = account(ends[0])
    assert kept.refused == 0
    contradict(*ends)
    kept.silent(2 * WATCHDOG_NS)
    assert kept.refused == 1
    assert kept.of_watchdog(STOPPED) == kept.of_silence(STOPPED) == ""
    kept.begin(ARMED)
    assert kept.refused == 0


@pytest.mark.parametrize("frames", [1, 2])
def test_lost_and_damaged_frames_are_added_up(ends: tuple[Endpoint, Far], frames: int) -> None:
    host, far = ends
    kept = account(host)
    lose(host, far, frames)
    damage(host, far)
    words = f"{frames + 1} frames to the host and {{}} to the board"
    assert kept.of_silence(STOPPED).startswith(words.format(0))
    missed = STOPPED._replace(lost_seq=ARMED.lost_seq + frames + 1)
    assert kept.of_silence(missed).startswith(words.format(frames + 1))
