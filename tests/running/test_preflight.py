"""docs/safety.md, The host, rule 2: what is looked at before ARM, field by field and register by register."""

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from estimator.core.layout import MAX_LATENCY
from hil.bench import Bench, override
from hil.bench.plausible import FASTEST_HZ, LARGEST_V
from hil.errors import InputError
from hil.inputs.declared import board_dither_of, board_filter_of, drive_limit_of
from hil.running.safety import preflight
from hil.running.safety.preflight import (
    configure,
    require_clock,
    require_plausible,
    require_suitable,
    require_unchanged,
    require_undone,
)
from hil.wire import endpoint
from hil.wire.endpoint import Endpoint
from hil.wire.errors import ProtocolError
from hil.wire.link import Link
from hil.wire.messages import (
    Capabilities,
    Identity,
    Message,
    RegisterRead,
    RegisterValue,
    RegisterWrite,
    TimeSync,
)
from hil.wire.spec import SPEC
from hil.wire.stream import Receiver, Transmitter
from tests.running import gyro
from tests.running.misbehaving import Board
from tests.running.on_a_pty import Far, connected

GOOD = Board().identity
GAIN = {"mode": "gain", "block": 4, "estimate_every": 4}
LINK = "serial:/dev/ttyACM0"
NUMBER = {name: register.id for name, register in SPEC.registers.items()}


def bench(clock: str = "paced", **changes: Any) -> Bench:
    return gyro.unhurried_bench(1.0, clock, **({"link": {"timeout_s": 5.0, "watchdog_s": 0.5}} | changes))


def refused(identity: Identity, **known: Any) -> str:
    with pytest.raises(InputError) as told:
        require_suitable(known.get("bench", bench()), identity, LINK)
    line = str(told.value)
    assert line.startswith(f"{LINK}: ")
    assert "\n" not in line
    assert ";" in line  # what to do
    return line


@pytest.mark.parametrize("name", ["hysteretic_stiffness", "play"])
def test_what_no_loop_can_undo_is_refused(name: str) -> None:
    usual = override(bench(), {"effects": {"cubic_stiffness": {}, "dry_friction": {}}}, "usual")
    require_undone(usual)
    with pytest.raises(InputError, match=rf"^\[effects\.{name}\]: no control law compensates it yet; .*`hil trace`$"):
        require_undone(override(usual, {"effects": {name: {}}}, "with it"))


# ------------------------------------------------------------------------------------------------------------ IDENTITY


def test_a_board_as_declared_is_suitable() -> None:
    require_plausible(GOOD, LINK)
    require_suitable(bench(), GOOD, LINK)
    require_suitable(bench("lockstep"), GOOD, LINK)


@pytest.mark.parametrize("field", ["tick_rate_Hz", "sense_scale_V", "drive_scale_mps2"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf"), float("-inf")])
def test_scales_and_rate_are_finite_and_positive(field: str, value: float) -> None:
    with pytest.raises(
        InputError, match=rf"IDENTITY\.{field} is .*, must be finite and positive; correct the firmware$"
    ):
        require_plausible(GOOD._replace(**{field: value}), LINK)


@pytest.mark.parametrize(("field", "least", "most"), [("sense_bits", 2, 24), ("drive_bits", 2, 24), ("axes", 1, 2)])
def test_bits_and_axes_are_within_what_there_can_be(field: str, least: int, most: int) -> None:
    for value in (least, most):
        require_plausible(GOOD._replace(**{field: value}), LINK)
    for value in (0, least - 1, most + 1, 255):
        with pytest.raises(
            InputError, match=rf"IDENTITY\.{field} is {value}, must be {least} to {most}; correct the firmware$"
        ):
            require_plausible(GOOD._replace(**{field: value}), LINK)


def test_a_latency_is_within_what_the_observer_can_queue() -> None:
    for latency in (MAX_LATENCY + 1, 1000, 65535):
        with pytest.raises(InputError, match=rf"latency_ticks is {latency}, this host can queue"):
            require_plausible(GOOD._replace(latency_ticks=latency), LINK)
    for latency in (0, 3, MAX_LATENCY):
        require_plausible(GOOD._replace(latency_ticks=latency), LINK)


def test_a_board_that_there_cannot_be_is_not_suitable_though_it_agrees() -> None:
    with pytest.raises(InputError, match=r"latency_ticks is 200, this host can queue"):
        require_suitable(bench(), GOOD._replace(latency_ticks=200), LINK)


def test_a_board_that_does_not_agree_with_the_bench_file_is_refused() -> None:
    remedy = "correct the bench file, or the board's IDENTITY"
    told = f"{LINK}: the board samples at 500 Hz, [device] sample_rate_Hz says 400; {remedy}"
    assert refused(GOOD._replace(tick_rate_Hz=500.0)) == told
    assert refused(GOOD._replace(axes=1)) == f"{LINK}: the board has 1 axes, [device] axes says 2; {remedy}"


@pytest.mark.parametrize(
    ("lacks", "changes", "words"),
    [
        (Capabilities.LOCKSTEP, {"clock": "lockstep"}, 'use [loop] clock = "paced"'),
        (Capabilities.PACED, {"clock": "paced"}, 'use [loop] clock = "lockstep"'),
        (Capabilities.FORCE_MODE, {"loop": {"mode": "force"}}, 'use [loop] mode = "gain"'),
        (
            Capabilities.GAIN_MODE,
            {"loop": {"mode": "gain", "block": 4, "estimate_every": 4}},
            'use [loop] mode = "force"',
        ),
    ],
)
def test_only_what_is_asked_and_impossible_is_refused(lacks: Capabilities, changes: dict[str, Any], words: str) -> None:
    every = Capabilities.LOCKSTEP | Capabilities.PACED | Capabilities.FORCE_MODE | Capabilities.GAIN_MODE
    declared = bench(changes.get("clock", "paced"), **{key: value for key, value in changes.items() if key != "clock"})
    require_suitable(declared, GOOD._replace(capabilities=int(every)), LINK)
    assert words in refused(GOOD._replace(capabilities=int(every & ~lacks)), bench=declared)
    neither = every & ~(Capabilities.FORCE_MODE | Capabilities.GAIN_MODE)
    assert "neither force nor gain mode" in refused(GOOD._replace(capabilities=int(neither)), bench=declared)
    other = {Capabilities.FORCE_MODE: Capabilities.GAIN_MODE, Capabilities.GAIN_MODE: Capabilities.FORCE_MODE}
    other |= {Capabilities.LOCKSTEP: Capabilities.PACED, Capabilities.PACED: Capabilities.LOCKSTEP}
    require_suitable(declared, GOOD._replace(capabilities=int(every & ~other[lacks])), LINK)


@pytest.mark.parametrize("axis", ["x", "y"])
@pytest.mark.parametrize("sign", [1, -1])
def test_two_codes_are_the_least_swing_and_half_the_range_the_most(axis: str, sign: int) -> None:
    def gains(odd: float) -> Bench:
        pair = (odd, -885.42) if axis == "x" else (-885.42, odd)
        return bench(device={"amplitude_m": 100e-6, "sense": {"gain_V_per_m": pair}})

    code, half = sign * GOOD.sense_scale_V / 100e-6, sign * GOOD.sense_scale_V * 2**15 / 100e-6
    for good in (2.01 * code, 0.99 * half):
        require_suitable(gains(good), GOOD, LINK)
    least = refused(GOOD, bench=gains(1.99 * code))
    assert f"V on {axis}, a code of the board's converter 7.63e-06 V" in least
    assert "nothing could be measured" in least
    assert f"V on {axis}, the board's converter ends at ± 0.25 V" in refused(GOOD, bench=gains(1.01 * half))


def test_a_drive_of_less_than_a_code_is_refused_unless_nothing_is_driven() -> None:
    device = {"drive": {"full_scale": 0.1}}
    coarse = GOOD._replace(drive_scale_mps2=0.11)
    assert "less than one code, 0.11 m/s²" in refused(coarse, bench=bench(device=device))
    require_suitable(bench(device=device), GOOD._replace(drive_scale_mps2=0.1 / 1.01), LINK)
    require_suitable(bench(device=device, controller={"enabled": False}), coarse, LINK)


# ----------------------------------------------------------------------------------------------------------- registers


class Registers:
    """A board's, on a pty: `values` as written; `kept` reads something else, whatever was written."""

    def __init__(self, far: Far) -> None:
        self.values: dict[int, float] = {}
        self.kept: dict[int, float] = {}
        self.after: dict[int, dict[int, float]] = {}  # what writing one does to others
        self.written: list[int] = []
        far.answer = self._answer

    def _answer(self, message: Message) -> list[Message]:
        match message:
            case RegisterWrite(number, value):
                self.written.append(number)
                self.values |= {number: value} | self.after.get(number, {})
                return [RegisterValue(number, value)]
            case RegisterRead(number):
                return [RegisterValue(number, self.kept.get(number, self.values[number]))]
        return []


@pytest.fixture
def ends() -> Iterator[tuple[Endpoint, Far]]:
    with connected() as both:
        yield both


def test_registers_are_written_and_read_back(ends: tuple[Endpoint, Far]) -> None:
    host, far = ends
    board = Registers(far)
    held = configure(host, GOOD, bench())
    assert {NUMBER[name]: value for name, value in held.items()} == board.values
    assert held["WATCHDOG_TICKS"] == 200  # 0.5 s at 400 Hz
    assert held["CLOCK_MODE"] == 1
    assert held["LOOP_MODE"] == 0
    assert held["BLOCK"] == 1
    assert held["DRIVE_LIMIT"] >= 1
    assert 1 <= held["SESSION"] < 2**32
    assert configure(host, GOOD, bench())["SESSION"] != held["SESSION"]  # a number of its own


def test_a_session_number_is_never_that_of_a_board_that_restarted(
    ends: tuple[Endpoint, Far], monkeypatch: pytest.MonkeyPatch
) -> None:
    """SESSION is 0 after every start (The board, rule 9)."""
    Registers(ends[1])
    for drawn in (lambda most: 0, lambda most: most - 1):
        monkeypatch.setattr("secrets.randbelow", drawn)
        assert 1 <= configure(ends[0], GOOD, bench())["SESSION"] <= 0xFFFFFFFF


@pytest.mark.parametrize(
    ("watchdog_s", "rate_Hz", "ticks"), [(0.4987, 400.0, 200), (0.4987, 800.0, 399), (0.02, 10.0, 2), (0.02, 400.0, 8)]
)
def test_a_watchdog_is_whole_ticks_of_the_board_and_at_least_two(
    ends: tuple[Endpoint, Far], watchdog_s: float, rate_Hz: float, ticks: int
) -> None:
    Registers(ends[1])
    declared = bench(link={"timeout_s": 0.5, "watchdog_s": watchdog_s})
    assert configure(ends[0], GOOD._replace(tick_rate_Hz=rate_Hz), declared)["WATCHDOG_TICKS"] == ticks


@pytest.mark.parametrize(
    "name", ["CLOCK_MODE", "LOOP_MODE", "BLOCK", "WATCHDOG_TICKS", "DRIVE_LIMIT", "SESSION"]
    + [f"FILTER_{name}" for name in ("A11", "A12", "A21", "A22", "B1", "B2", "C1", "C2", "DELAY")]
    + ["DITHER_AMPLITUDE", "DITHER_SEED"],
)  # fmt: skip
def test_each_that_reads_otherwise_is_refused(ends: tuple[Endpoint, Far], name: str) -> None:
    host, far = ends
    Registers(far).kept[NUMBER[name]] = 77.0
    with pytest.raises(ProtocolError, match=rf"{name} reads 77 after .* was written"):
        configure(host, GOOD, bench(loop=GAIN))


def test_one_that_changes_with_a_later_one_is_seen(ends: tuple[Endpoint, Far]) -> None:
    """All of them are read once more when the last one is written."""
    host, far = ends
    board = Registers(far)
    configure(host, GOOD, bench())
    first, last = board.written[0], board.written[-1]
    board.after[last] = {first: 77.0}
    with pytest.raises(ProtocolError, match="reads 77"):
        configure(host, GOOD, bench())


def test_before_it_is_armed_again_every_one_reads_as_written_session_first(ends: tuple[Endpoint, Far]) -> None:
    host, far = ends
    board = Registers(far)
    held = configure(host, GOOD, bench())
    require_unchanged(host, held, 0.5)
    for name in held:
        board.kept = {NUMBER[name]: held[name] + 1.0}
        with pytest.raises(ProtocolError, match=f"the board restarted, or another host wrote it: {name} reads"):
            require_unchanged(host, held, 0.5)
    board.kept = dict.fromkeys(board.values, 0.0)
    with pytest.raises(ProtocolError, match="SESSION reads 0"):
        require_unchanged(host, held, 0.5)


# --------------------------------------------------------------------------------------------------------------- clock


class ByTheClock(Link):
    """A board that answers TIME_SYNC after `late_s`, `pace` times its own time in it, with a clock that only waiting
    moves; the first `deaf` questions it does not hear.
    """

    name = "board"

    def __init__(self, monkeypatch: pytest.MonkeyPatch, pace: float, late_s: float = 0.0, deaf: int = 0) -> None:
        self.now_ns, self.asked_ns = 10**12, list[int]()
        self._pace, self._late_ns, self._deaf = pace, round(1e9 * late_s), deaf
        self._due: list[tuple[int, bytes]] = []
        self._rx, self._tx = Receiver(), Transmitter()
        clock = SimpleNamespace(
            monotonic=lambda: 1e-9 * self.now_ns, monotonic_ns=lambda: self.now_ns, sleep=self.pass_s
        )
        for module in (preflight, endpoint):
            monkeypatch.setattr(module, "time", clock)

    def pass_s(self, seconds: float) -> None:
        self.now_ns += max(round(1e9 * seconds), 1)

    def fileno(self) -> int:
        return 0

    def send(self, data: bytes) -> None:
        for item in self._rx.feed(data):
            assert isinstance(item.message, TimeSync)
            self.asked_ns.append(self.now_ns - 10**12)
            if len(self.asked_ns) > self._deaf:
                told = 2 * 10**12 + round(self._pace * (self.now_ns + self._late_ns // 2))
                answer = item.message._replace(board_ns=told)
                self._due.append((self.now_ns + self._late_ns, self._tx.encode(answer, 0)))

    def receive(self, timeout_s: float | None) -> bytes:
        assert timeout_s is not None
        if self._due and self._due[0][0] <= self.now_ns + round(1e9 * timeout_s):
            at_ns, data = self._due.pop(0)
            self.now_ns = max(self.now_ns, at_ns)
            return data
        self.pass_s(timeout_s)
        return b""

    def close(self) -> None:
        """Nothing is open."""

    @property
    def passed_s(self) -> float:
        return pytest.approx(1e-9 * (self.now_ns - 10**12), abs=1e-6)


@pytest.mark.parametrize(
    ("pace", "good"),
    [(pace, False) for pace in (-1.0, 0.0, 1e-3, 0.899, 1.101, 1e3)] + [(pace, True) for pace in (0.901, 1.0, 1.099)],
)
def test_a_tenth_is_borne_over_a_twentieth_of_a_second(
    monkeypatch: pytest.MonkeyPatch, pace: float, good: bool
) -> None:
    link = ByTheClock(monkeypatch, pace)
    host = Endpoint(link)
    if good:
        require_clock(host)
    else:
        with pytest.raises(ProtocolError, match=rf"board: .* went on by {0.05 * pace:.3g} s in 0.05 s; correct"):
            require_clock(host)
    assert link.passed_s == 0.05
    assert not host.exchanges


@pytest.mark.parametrize(("excess", "good"), [(0.99, True), (1.01, False)])
@pytest.mark.parametrize("sign", [1, -1])
def test_so_much_more_as_the_round_trips_leave_open(
    monkeypatch: pytest.MonkeyPatch, sign: int, excess: float, good: bool
) -> None:
    """Each answer may have been given at any time of its round trip: 10 ms each, of 60 ms between the two."""
    bound = 1.1 * (0.06 + 0.02) / 0.06 if sign > 0 else 0.9 * (0.06 - 0.02) / 0.06
    pace = bound * (excess if sign > 0 else 1.0 / excess)
    host = Endpoint(ByTheClock(monkeypatch, pace, late_s=0.01))
    if good:
        require_clock(host)
    else:
        with pytest.raises(ProtocolError, match=r"in 0\.06 s"):
            require_clock(host)


@pytest.mark.parametrize(("deaf", "passed_s"), [(9, 0.1), (0, 0.15)])
def test_an_answer_is_waited_for_a_tenth_of_a_second(
    monkeypatch: pytest.MonkeyPatch, deaf: int, passed_s: float
) -> None:
    link = ByTheClock(monkeypatch, 3.0, deaf=deaf)
    if not deaf:  # it hears the first question alone
        plain = link.send
        monkeypatch.setattr(link, "send", lambda data: plain(data) if not link.asked_ns else None)
    require_clock(Endpoint(link))
    assert link.passed_s == passed_s


def test_an_answer_to_an_earlier_question_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """As one that came late; samples that come meanwhile are kept."""
    link = ByTheClock(monkeypatch, 3.0, late_s=0.12)
    host = Endpoint(link)
    link.send(Transmitter().encode(TimeSync(5, 0), 0))
    link.pass_s(0.11)
    require_clock(host)
    assert link.passed_s == 0.21


# ------------------------------------------------------------------------------------------- where exactly a bound lies


@pytest.mark.parametrize(
    ("field", "least", "most"),
    [
        ("tick_rate_Hz", 1e-3, FASTEST_HZ),
        ("sense_scale_V", 1e-15, LARGEST_V),
        ("drive_scale_mps2", 1e-15, 1e6),
    ],
)
def test_a_scale_at_its_bound_is_plausible_and_beyond_it_is_none(field: str, least: float, most: float) -> None:
    for value in (least, most):
        require_plausible(GOOD._replace(**{field: value}), LINK)
    for value in (0.9 * least, 1.1 * most):
        with pytest.raises(InputError, match=rf"IDENTITY\.{field} is .*, no board has that: .*; correct the firmware$"):
            require_plausible(GOOD._replace(**{field: value}), LINK)


def test_a_dither_of_less_than_a_code_is_refused_where_the_board_adds_it() -> None:
    declared = bench(loop=GAIN)
    code = declared.controller.dither_mps2
    closes = GOOD._replace(capabilities=GOOD.capabilities | Capabilities.GAIN_MODE)
    require_suitable(declared, closes._replace(drive_scale_mps2=0.99 * code), LINK)
    assert "the board would add nothing" in refused(closes._replace(drive_scale_mps2=1.01 * code), bench=declared)
    require_suitable(bench(), GOOD._replace(drive_scale_mps2=1.01 * code), LINK)


def test_a_board_filter_s_matrices_are_in_their_named_registers(ends: tuple[Endpoint, Far]) -> None:
    registers = Registers(ends[1])
    declared = bench(loop=GAIN)
    held, board = configure(ends[0], GOOD, declared), board_filter_of(declared)
    assert (held["LOOP_MODE"], held["BLOCK"]) == (1, 4)
    assert {NUMBER[name] for name in held} == set(registers.values)
    for i in range(2):
        assert (held[f"FILTER_B{i + 1}"], held[f"FILTER_C{i + 1}"]) == (board.b[i], board.c[i])
        for j in range(2):
            assert held[f"FILTER_A{i + 1}{j + 1}"] == board.a[i][j]
    assert held["FILTER_DELAY"] == board.delay
    assert (held["DITHER_AMPLITUDE"], held["DITHER_SEED"]) == board_dither_of(declared, GOOD)
    assert held["DRIVE_LIMIT"] == drive_limit_of(declared, GOOD)


@pytest.mark.parametrize(("clock", "number"), [("lockstep", 0), ("paced", 1)])
def test_the_clock_is_that_of_the_bench_file(ends: tuple[Endpoint, Far], clock: str, number: int) -> None:
    Registers(ends[1])
    assert configure(ends[0], GOOD, bench(clock))["CLOCK_MODE"] == number
