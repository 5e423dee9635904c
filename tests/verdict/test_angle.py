"""The angle's part of the verdict: docs/reference/run-folder.md (Verdict) and [limits] in docs/reference/bench.md."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil.bench import Bench, override
from hil.numbers import quantity
from hil.records.capture import Capture
from hil.records.estimates import Estimates
from hil.records.result import Contribution, Lacking, OnBoard, OwnReading, Part, Result, Scan, Score
from hil.records.runfolder import RunFolder
from hil.records.sensing import SenseFault
from hil.verdict.angle import judge_angle, remedy
from tests.running import gyro
from tests.verdict.gyro_estimates import SETTLE_S, estimates

LARGEST = Contribution(source="clock", value=1e-3, unit="1", sensitivity="1", contribution_rad=0.04)


def bench(*, controlled: bool = True, **limits: float) -> Bench:
    declared = {"energy_error": 0.05, "quadrature": 0.1, "invalid_fraction": 0.1, "angle_rad": 0.1} | limits
    control = {"enabled": controlled}
    return gyro.bench(10.0, loop={"settle_s": SETTLE_S}, limits=declared, controller=control)


def judged(
    found: Estimates | None,
    u: float | None = 0.09,
    capture: Capture | None = None,
    score: Score | None = None,
    rms: float | None = None,
    controlled: bool = True,
    faults: tuple[SenseFault, ...] = (),
    changes: dict[str, Any] | None = None,
    ratio: float = 1.0,
    scan: Scan | None = None,
    board: Estimates | None = None,
    apart: OnBoard | None = None,
    own: OwnReading | None = None,
    **limits: float,
) -> Part:
    folder = RunFolder(Path("nowhere"))
    vars(folder).update(estimates=found, capture=capture, board_estimates=board)
    rows = () if u is None else (LARGEST,)
    result = Result(
        run="r",
        seconds=10.0,
        samples=101,
        complete=True,
        angle_expanded_rad=u,
        uncertainty=rows,
        score=score,
        angle_error_rms_rad=rms,
        innovation_rms=ratio * 1e-4,
        noise_floor=1e-4,
        scan=scan,
        board=apart,
        own_reading=own,
    )
    return judge_angle(folder, result, override(bench(controlled=controlled, **limits), changes or {}, "test"), faults)


COMPLETE = Scan(complete=True, reason="", samples=1, span_s=1.0, seconds=1.0)


@pytest.mark.parametrize(("off", "outcome"), [(0.149, "good"), (0.151, "failed"), (-0.151, "failed"), (-0.149, "good")])
def test_a_plug_in_is_held_against_the_bench_s_own_observer(off: float, outcome: str) -> None:
    """Uncertain by 0.09 and 0.12 rad: 0.15 rad together."""
    own = OwnReading(plugin_rad=2.0 + off, own_rad=2.0, own_expanded_rad=0.12)
    assert judged(estimates(), own=own, scan=COMPLETE).outcome == outcome
    # Of a model that lacks something nobody knows which of the two is right.
    assert judged(estimates(), own=own, scan=COMPLETE.model_copy(update={"complete": None})).outcome == "good"


STUCK = SenseFault("channel x repeated one code", "check the cable", from_s=1.0, until_s=2.5, voids=True)


@pytest.mark.parametrize(
    ("fault", "outcome"),
    [(STUCK, "failed"), (STUCK._replace(until_s=1.9), "good"), (STUCK._replace(voids=False), "good")],
)
def test_a_channel_that_fails_in_the_scored_window_fails_the_angle(fault: SenseFault, outcome: str) -> None:
    part = judged(estimates(), faults=(fault,))
    assert part.outcome == outcome
    if outcome == "failed":
        assert part.reason == "its uncertainty does not hold: channel x repeated one code"
        assert part.next == "check the cable"


def test_an_uncertainty_that_does_not_hold_has_no_largest_source() -> None:
    part = judged(estimates(), 3.0, faults=(STUCK,))
    assert "largest source" not in part.reason
    assert part.next == "check the cable"


def scan(*lacks: Lacking) -> Scan:
    return Scan(complete=False, reason="something is missing", lacks=lacks, samples=9, span_s=1.0, seconds=0.1)


def test_an_uncertainty_of_a_model_that_does_not_predict_the_record_does_not_hold() -> None:
    """[limits] innovation_ratio is 1.5; what the scan could name is a row of the budget."""
    named = Lacking(effect="drive_gain", coefficients={}, angle_rad=0.01, angle_ci95=(0.0, 0.02))
    assert judged(estimates(), ratio=1.4, scan=scan()).outcome == "good"
    assert judged(estimates(), ratio=2.2, scan=scan(named)).outcome == "good"
    for unexplained in (scan(), None):
        part = judged(estimates(), ratio=2.2, scan=unexplained)
        assert part.outcome == "failed"
        assert part.reason.startswith("its uncertainty does not hold: innovation 2.2 × the noise floor")


def odd(usual: float, value: float, rows: int) -> np.ndarray:
    """So many of the scored rows, the last ones, have that value; before the window all have."""
    values = np.full(101, usual)
    values[:20] = value
    values[101 - rows :] = value
    return values


def test_an_angle_within_its_limits_is_good_and_says_how_uncertain() -> None:
    part = judged(estimates())
    assert (part.outcome, part.reason, part.next) == ("good", "uncertain by 90\u00a0mrad (k = 2) at the end", None)


@pytest.mark.parametrize(("off", "outcome"), [(0.019, "good"), (0.021, "failed"), (None, "good")])
def test_a_truth_that_contradicts_the_angle_fails_it(off: float | None, outcome: str) -> None:
    """From two expanded uncertainties on, which are four standard ones."""
    score = Score(window_s=(4.0, 10.0), rows=61, turns=1.0, angle_error_end_rad=off)
    part = judged(estimates(), 0.0100, score=score)
    assert part.outcome == outcome
    assert ("the truth contradicts the angle: at the end it is off by 21\u00a0mrad" in part.reason) == (off == 0.021)


@pytest.mark.parametrize(("rms", "outcome"), [(0.0099, "good"), (0.0101, "failed")])
def test_an_error_above_the_uncertainty_rms_fails_it(rms: float, outcome: str) -> None:
    score = Score(window_s=(4.0, 10.0), rows=61, turns=1.0, angle_error_end_rad=0.001)
    part = judged(estimates(), 0.0100, score=score, rms=rms)
    assert part.outcome == outcome
    assert ("it is off by 10\u00a0mrad rms, and uncertain by 10\u00a0mrad (k = 2) at the end" in part.reason) == (
        outcome == "failed"
    )


def test_an_error_that_a_reversal_takes_back_is_held_against_the_uncertainty_of_its_time() -> None:
    """1 mrad at the end and 3 mrad before it: U of 10 mrad at the end is 30 mrad there."""
    course = np.full(101, 3e-3)
    course[-1] = 1e-3
    score = Score(window_s=(4.0, 10.0), rows=61, turns=1.0, angle_error_end_rad=0.001)
    outcomes = [judged(estimates(angle_u_rad=course), 0.0100, score=score, rms=rms).outcome for rms in (0.029, 0.031)]
    assert outcomes == ["good", "failed"]


@pytest.mark.parametrize("u", [0.101, 3.0])
def test_the_expanded_uncertainty_is_held_against_its_limit(u: float) -> None:
    assert judged(estimates(), 0.0999).outcome == "good"
    part = judged(estimates(), u)
    assert part.outcome == "failed"
    said = f"uncertain by {quantity(u, 'rad', 2)} (k = 2), [limits] angle_rad is 0.1; largest source: clock, "
    said += "U = 80\u00a0mrad"
    assert said in part.reason
    assert part.next == remedy(LARGEST, bench()).text


@pytest.mark.parametrize(
    ("column", "usual", "value"),
    [
        ("energy_ratio", 1.0, 1.06),
        ("energy_ratio", 1.0, 0.94),
        ("energy_ratio", 1.0, np.nan),
        ("quadrature_ratio", 0.0, 0.11),
        ("quadrature_ratio", 0.0, -0.11),
        ("quadrature_ratio", 0.0, np.nan),
    ],
)
def test_an_angle_that_was_not_valid_for_too_long_has_failed(column: str, usual: float, value: float) -> None:
    assert judged(estimates(**{column: odd(usual, value, 8)})).outcome == "good"  # 8 of 81: 9.9 %
    part = judged(estimates(**{column: odd(usual, value, 9)}))
    assert part.outcome == "failed"
    assert "not valid 11.11\u00a0% of the time" in part.reason
    energy = column == "energy_ratio"
    assert f"energy off target {'11.11' if energy else '0.00'}\u00a0%" in part.reason
    assert f"quadrature too large {'0.00' if energy else '11.11'}\u00a0%" in part.reason
    assert part.next is not None
    assert part.next.endswith(f"[controller] {'energy' if energy else 'quadrature'}_gain")


@pytest.mark.parametrize(
    ("column", "value"), [("energy_ratio", 1.04), ("energy_ratio", 0.96), ("quadrature_ratio", 0.09)]
)
def test_up_to_its_limits_it_counts_as_valid(column: str, value: float) -> None:
    assert judged(estimates(**{column: np.full(101, value)})).outcome == "good"


def test_both_count_together() -> None:
    apart = estimates(energy_ratio=odd(1.0, 2.0, 5), quadrature_ratio=np.where(np.arange(101) // 5 == 10, 1.0, 0.0))
    part = judged(apart)
    assert (
        "not valid 12.35\u00a0% of the time (energy off target 6.17\u00a0%, quadrature too large 6.17\u00a0%)"
        in part.reason
    )


def test_what_fails_twice_says_both_and_what_lowers_the_uncertainty() -> None:
    part = judged(estimates(energy_ratio=2.0), 0.2)
    assert part.reason.index("was not valid 100.00\u00a0%") < part.reason.index("uncertain by 200\u00a0mrad")
    assert part.next == "check [device] mass_kg, the gains of sense and drive, and [controller] energy_gain"


@pytest.mark.parametrize(
    ("changes", "holds"),
    [
        ({"controller": {"plugin": "mine.py:Mine"}}, "[controller] plugin"),
        ({"loop": {"mode": "board", "block": 40}, "link": {"watchdog_s": 0.2}}, "hil generate"),
    ],
)
def test_what_the_drive_does_not_hold_is_looked_for_in_what_drives(changes: dict[str, Any], holds: str) -> None:
    part = judged(estimates(energy_ratio=2.0), 0.2, changes=changes)
    assert part.next is not None
    assert holds in part.next


def test_an_integrated_rate_needs_no_slender_ellipse() -> None:
    rate = estimates({"angle": "rate"}, energy_ratio=3.0, quadrature_ratio=1.0)
    assert judged(rate).outcome == "good"
    assert judged(rate, 0.2).outcome == "failed"


def test_an_angle_of_which_nobody_knows_the_uncertainty_has_failed() -> None:
    part = judged(estimates(), None)
    assert part.outcome == "failed"
    assert "not finite" in part.reason
    assert "not finite" not in judged(estimates(energy_ratio=2.0), None).reason


def recorded(**header: Any) -> Capture:
    return Capture({"tick": np.arange(3)}, {"tick_rate_Hz": 10.0, **header}, True)


def test_without_an_angle_there_is_nothing_to_judge() -> None:
    silent = estimates({"angle": "none"})
    for run in (None, recorded(identity={"unique_id": "a1"})):
        part = judged(silent, None, run, controlled=False)
        assert part.outcome == "unknown"
        assert part.reason.startswith("no angle to judge: without control")
    part = judged(silent, None, recorded())
    assert part.outcome == "unknown"
    assert "imported record" in part.reason


def test_where_there_is_nothing_to_judge_it_by_it_is_unknown() -> None:
    single = estimates()
    del single.columns["energy_ratio"]  # type: ignore[attr-defined]
    few = "row{} of estimates in the scored window, at least 2 are needed"
    for found, reason in (
        (None, "no estimates were recorded"),
        (single, "a single axis has none"),
        (estimates().part(0, 20), f"0 {few.format('s')}"),  # the run ended before the scored window began
        (estimates().part(0, 21), f"1 {few.format('')}"),
    ):
        part = judged(found, None)
        assert (part.outcome, part.reason) == ("unknown", f"no angle to judge: {reason}")


SAID = {"states": ["rate_rad_s"]}


def on_board(
    *, angle_rad: float = 0.0, rms_rad: float = 0.0, rate_rad_s: float = 0.0, valid: float = 1.0, sd: float = 0.0
) -> Part:
    """A host whose U is 30 mrad, 2·0.02 rad/s of the rate; the board says `sd` of both."""
    host = estimates(SAID, rate_rad_s=0.5, sd_rate_rad_s=0.02)
    board = estimates(SAID, rate_rad_s=0.5, sd_rate_rad_s=sd, angle_sd_rad=sd)
    apart = OnBoard(
        rows=101,
        valid_fraction=valid,
        angle_difference_end_rad=angle_rad,
        angle_difference_rms_rad=rms_rad,
        rate_difference_rms_rad_s=rate_rad_s,
    )
    return judged(host, 0.03, board=board, apart=apart)


@pytest.mark.parametrize(
    ("apart", "said"),
    [
        ({"angle_rad": 0.029, "rms_rad": 0.029, "rate_rad_s": 0.039, "sd": 1e-6}, ""),
        ({"angle_rad": 0.031, "sd": 1e-6}, "the angle by 31\u00a0mrad at the end, uncertain by 30\u00a0mrad (k = 2)"),
        ({"rms_rad": 0.2, "sd": 1e-6}, "the angle by 200\u00a0mrad rms, uncertain by 30\u00a0mrad (k = 2)"),
        ({"angle_rad": 0.099}, ""),  # it gives no uncertainty
        ({"rms_rad": 0.2}, "the angle by 200\u00a0mrad rms, with no uncertainty of it, [limits] angle_rad is 0.1"),
        ({"rate_rad_s": 0.041}, "the rate by 41\u00a0mrad/s rms, uncertain by 40\u00a0mrad/s (k = 2)"),
        ({"angle_rad": 0.049, "rate_rad_s": 0.056, "sd": 0.02}, ""),  # its own deviation beside the host's
        ({"angle_rad": 0.051, "sd": 0.02}, "the angle by 51\u00a0mrad at the end, uncertain by 50\u00a0mrad (k = 2)"),
    ],
)
def test_what_the_board_estimates_is_held_against_the_host(apart: dict[str, float], said: str) -> None:
    part = on_board(**apart)
    assert part.outcome == ("failed" if said else "good"), part.reason
    if said:
        assert part.reason == f"the board's own estimates are not the host's: {said}"


@pytest.mark.parametrize(("valid", "outcome"), [(0.91, "good"), (0.89, "failed")])
def test_a_board_that_calls_its_angle_not_valid_for_too_long_has_failed(valid: float, outcome: str) -> None:
    part = on_board(valid=valid)
    assert part.outcome == outcome
    assert ("the board calls its own angle not valid 11.00\u00a0% of the time" in part.reason) == (outcome == "failed")


PLUGGED = {"plugins": {"observer": "mine.py:Mine"}, "states": ["rate_rad_s"]}


def plugged(angle: np.ndarray, rate_integral: np.ndarray, u: float | None = 0.05, sd: float = np.nan) -> Part:
    said = np.full(101, np.nan) if u is None else np.full(101, 1e-3)
    found = estimates(
        PLUGGED, angle_rad=angle, angle_rate_integral_rad=rate_integral, angle_sd_rad=said, sd_rate_rad_s=sd
    )
    return judged(found, u)


COURSE = 0.05 * np.arange(101)
"""Of a turn of 4 rad over the scored window."""


@pytest.mark.parametrize("u", [0.05, None])
def test_an_angle_against_the_sign_of_its_own_rate_fails(u: float | None) -> None:
    part = plugged(-COURSE, COURSE, u)
    assert part.outcome == "failed"
    assert "the angle goes −4.00 rad where the integral of the rate goes +4.00 rad: a wrong sign" in part.reason


@pytest.mark.parametrize("factor", [180.0 / np.pi, -1.0, 0.4])
def test_an_angle_in_another_unit_than_its_rate_fails(factor: float) -> None:
    assert plugged(factor * COURSE, COURSE).outcome == "failed"


def test_there_and_back_it_fails_too() -> None:
    there = 2.0 * np.sin(np.linspace(0.0, 2.0 * np.pi, 101))
    assert plugged(there, there).outcome == "good"
    assert plugged(-there, there).outcome == "failed"


@pytest.mark.parametrize(
    ("angle", "integral", "sd"),
    [
        (COURSE, COURSE, np.nan),
        (COURSE, 1.4 * COURSE, np.nan),  # a rate whose bias adds up
        (0.01 * COURSE, -0.9 * COURSE, np.nan),  # at rest there is nothing but its bias
        (COURSE, -0.2 * COURSE, 0.31),  # uncertain by 5 rad, were all of its error a bias
    ],
)
def test_a_rate_that_drifts_says_nothing_against_the_angle(angle: np.ndarray, integral: np.ndarray, sd: float) -> None:
    assert plugged(angle, integral, sd=sd).outcome == "good"
