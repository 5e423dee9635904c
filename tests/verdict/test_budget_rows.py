"""The rows of the angle's budget by hand, from the table of docs/explanation.md (Calibration), and their total.

What happened: 8 s were scored, in which the board turned by 4 rad and forces turned the pattern by 24.
"""

import math
import re
from typing import Any

import numpy as np
import pytest

from estimator.completeness.information import Information, ScannedCoefficient
from hil.bench import Bench, override
from hil.numbers import quantity
from hil.records.estimates import Estimates
from hil.records.result import Contribution
from hil.verdict.angle import remedy
from hil.verdict.budget import Budget, budget
from tests.running import gyro
from tests.verdict.gyro_estimates import DXX, DXY, DYY, KXY, RATE, SD, SECONDS, SETTLE_S, VIRTUAL, estimates

FORCED, TURNED = VIRTUAL * SECONDS, RATE * SECONDS
KEYS = {
    "drive gain": "drive_gain_u",
    "sense gain ratio": "sense_gain_ratio_u",
    "drive misalignment": "drive_misalignment_u",
    "sense cross coupling": "sense_cross_coupling_u",
    "drive delay": "drive_delay_u_s",
    "sense delay": "sense_delay_u_s",
    "clock": "clock_u",
    "angular gain": "angular_gain_u",
}
DELAY = math.sqrt(2.0) * 0.25 * KXY * SECONDS
# What one unit of each does, axes and the two ends at which the ellipse is seen added as squares: ½ sin 2θ at an
# unknown θ has a mean square of ⅛.
BY_HAND = {
    "drive gain": math.hypot(0.5 * FORCED + 0.25 * DXY * SECONDS, 0.5 * FORCED - 0.25 * DXY * SECONDS),
    "sense gain ratio": math.sqrt((0.5 * FORCED) ** 2 + (0.25 * DXY * SECONDS) ** 2 + 2 / 8),
    "drive misalignment": 0.25 * SECONDS * math.hypot(DYY, DXX),
    "sense cross coupling": math.sqrt((0.25 * SECONDS) ** 2 * (DXX**2 + DYY**2) + 4 / 8),
    "drive delay": DELAY,
    "sense delay": DELAY,
    "clock": 2.0 * FORCED,
    "angular gain": TURNED,
}


def bench(calibration: dict[str, float], **changes: Any) -> Bench:
    """What is declared of the constants, those not named as known exactly."""
    exact = dict.fromkeys(KEYS.values(), 0.0)
    device = {"calibration": exact | calibration} | changes.pop("device", {})
    return gyro.bench(10.0, device=device, loop={"settle_s": SETTLE_S}, **changes)


def made(calibration: dict[str, float], found: Estimates | None = None, **changes: Any) -> dict[str, Contribution]:
    done = budget(estimates() if found is None else found, bench(calibration, **changes))
    assert done.angle is not None
    return {row.source: row for row in done.uncertainty}


@pytest.mark.parametrize("source", KEYS)
def test_each_constant_by_the_table(source: str) -> None:
    u = 1e-6 if "delay" in source else 0.01
    rows = made({KEYS[source]: u})
    assert rows[source].contribution_rad == pytest.approx(u * BY_HAND[source], rel=1e-6)
    assert (rows[source].value, rows[source].assumed) == (u, False)
    assert rows[source].unit == ("s" if "delay" in source else "1")
    others = sum(row.contribution_rad for name, row in rows.items() if name not in (source, "estimation"))
    assert others == 0.0


def test_estimation_is_the_deviation_at_the_end() -> None:
    assert made({})["estimation"].contribution_rad == SD
    growing = estimates(angle_sd_rad=np.linspace(0.0, 0.02, 101))
    assert made({}, growing)["estimation"].contribution_rad == pytest.approx(0.02)


def test_u_is_the_root_of_the_sum_of_squares_and_the_largest_comes_first() -> None:
    done = budget(estimates(), bench({"clock_u": 1e-3, "angular_gain_u": 5e-3, "drive_gain_u": 1e-4}))
    known = [SD, 1e-3 * BY_HAND["clock"], 5e-3 * BY_HAND["angular gain"], 1e-4 * BY_HAND["drive gain"]]
    assert done.angle_u_rad == pytest.approx(math.sqrt(sum(value**2 for value in known)))
    assert done.angle_expanded_rad == pytest.approx(2.0 * math.sqrt(sum(value**2 for value in known)))
    assert [row.source for row in done.uncertainty][:4] == ["clock", "angular gain", "drive gain", "estimation"]


def test_what_is_not_declared_is_assumed_and_marked() -> None:
    done = budget(estimates(), gyro.bench(10.0, loop={"settle_s": SETTLE_S}))
    rows = {row.source: row for row in done.uncertainty}
    assert {row.assumed for name, row in rows.items() if name != "estimation"} == {True}
    assert rows["drive gain"].value == 0.01
    assert rows["angular gain"].value == 1e-3


@pytest.mark.parametrize("mode", ["force_to_rebalance", "mode_reversal"])
def test_a_pattern_that_is_held_is_turned_back_by_what_the_board_turns(mode: str) -> None:
    """The rate is the balancing force over 2ωA: by a clock fast by δ each force is less by 2δ."""
    assert made({"clock_u": 1e-3}, controller={"mode": mode})["clock"].contribution_rad == 2e-3 * TURNED


def test_in_open_loop_no_force_turned_anything() -> None:
    rows = made(dict.fromkeys(KEYS.values(), 1e-3), controller={"enabled": False})
    for name in ("drive gain", "drive misalignment", "drive delay", "sense delay", "clock"):
        assert rows[name].contribution_rad == 0.0
    assert rows["angular gain"].contribution_rad == pytest.approx(1e-3 * TURNED)


def test_an_angular_gain_makes_the_board_turn_by_less_than_its_pattern() -> None:
    rows = made({"angular_gain": 0.8, "drive_misalignment_u": 0.01})
    assert rows["drive misalignment"].contribution_rad == pytest.approx(0.01 * BY_HAND["drive misalignment"] / 0.8)


def test_seven_states_have_a_row_for_the_declared_damping() -> None:
    found = estimates({"angle": "rate"})
    device = {"damping_N_s_per_m": (1.3e-3, 1.1e-3, 0.4e-3)}  # what couples the axes is no mean of theirs
    rows = made({}, found, device=device, observer={"variant": "sense", "initial_sd": {"damping": 0.1}})
    declared = bench({}, device=device).device.damping_per_s
    value = 0.1 * 0.5 * (declared[0] + declared[1])
    row = rows["declared damping"]
    assert (row.value, row.unit) == (pytest.approx(value), "1/s")
    assert row.contribution_rad == pytest.approx(0.25 * math.sqrt(2.0) * value * SECONDS)
    assert "declared damping" not in made({})


def test_the_angle_is_zero_at_the_start_of_the_scored_window() -> None:
    t = np.arange(101) / 10.0
    plain = 7.0 + RATE * t + 0.02
    plain[-1] += 0.3
    pattern = 7.0 + RATE * t + 0.05 * (-1.0) ** np.arange(101)
    done = budget(estimates(angle_plain_rad=plain, angle_pattern_rad=pattern), bench({}))
    assert done.angle is not None
    assert done.angle.kind == "pattern"
    assert done.angle.rad == pytest.approx(TURNED)
    assert done.angle.plain_rad == pytest.approx(TURNED + 0.3)
    # Of the pattern against the reported angle, from where both are zero: 0 and −0.1 by turns, 41 and 40 times.
    assert done.angle.control_imperfection_rms_rad == pytest.approx(0.1 * math.sqrt(40 / 81))


def test_of_an_integrated_rate_there_is_no_pattern() -> None:
    done = budget(estimates({"angle": "rate"}), bench({}))
    assert done.angle is not None
    assert (done.angle.kind, done.angle.plain_rad, done.angle.control_imperfection_rms_rad) == ("rate", None, None)


NOTHING = Budget(None, None, None, ())


@pytest.mark.parametrize("column", ["angle_rad", "angle_pattern_rad", "angle_plain_rad", "angle_sd_rad"])
def test_of_what_is_not_finite_there_is_no_angle(column: str) -> None:
    values = np.zeros(101)
    values[100 if column == "angle_sd_rad" else 60] = np.nan
    assert budget(estimates(**{column: values}), bench({})) == NOTHING


def test_without_estimates_or_a_scored_window_there_is_no_angle() -> None:
    assert budget(None, bench({})) == NOTHING
    found = estimates()
    for rows in (0, 1, 21):  # the last one has one scored row
        assert budget(found.part(0, rows), bench({})) == NOTHING
    assert budget(found.part(0, 22), bench({})) != NOTHING


# ------------------------------------------------------------------------------------- what the scan knows of a record


def information(**found: Any) -> Information:
    """Gains hx and hy, of which the record says nothing, and an effect of another kind, "damper", of which it says as
    much as that 1 is a plausible size of it: 1 / √2 is left. One of it moves the angle by 0.2 rad.
    """
    coefficients = (
        ScannedCoefficient("drive_gain", "hx", "1", 0.05),
        ScannedCoefficient("drive_gain", "hy", "1", 0.05),
        ScannedCoefficient("damper: cubic", "c", "1", 1.0),
    )
    sensitivity = np.array([[0, 0, 0], [12.0, 12.0, 0.2]])
    return Information(coefficients, np.diag([0.0, 0.0, 1.0]), np.zeros(3), np.array([0.0, 1.0]), sensitivity, **found)


def left_of_the_damper() -> float:
    """Its mean square by hand: there or not at equal odds, of any of four sizes s; of each, s² becomes s²/(1 + s²) by a
    record that says as much as a size of 1, and predicts it worse than none by √(1 + s²).
    """
    sizes = [1.0, 0.1, 0.01, 0.001]
    chances = [0.25 / math.sqrt(1.0 + s * s) for s in sizes]
    squares = [s * s / (1.0 + s * s) for s in sizes]
    return sum(c * q for c, q in zip(chances, squares, strict=True)) / (1.0 + sum(chances))


def test_what_nobody_declared_is_a_row_too() -> None:
    declared = bench({"drive_gain_u": 0.01})
    rows = {row.source: row for row in budget(estimates(), declared, information()).uncertainty}
    row = rows["undeclared effects"]
    assert row.contribution_rad == pytest.approx(0.2 * math.sqrt(left_of_the_damper()))
    assert "damper" in row.sensitivity
    assert "harmless" not in row.sensitivity
    assert rows["drive gain"].contribution_rad == pytest.approx(0.01 * math.hypot(12.0, 12.0))
    assert "the record leaves" in rows["drive gain"].sensitivity
    assert re.search(
        r"half the rotation by drive forces, [\d.]+\u00a0m?rad = [\d.]+\u00a0[mµ]?rad; ", rows["drive gain"].sensitivity
    )
    assert "the record leaves" not in rows["angular gain"].sensitivity  # κ Ω is what Ω is
    without = {row.source for row in budget(estimates(), declared).uncertainty}
    assert "undeclared effects" not in without


def test_a_constant_watched_on_one_axis_has_its_closed_form() -> None:
    watched = information()
    coefficients = (
        watched.coefficients[0],
        *(ScannedCoefficient("drive_misalignment", name, "1", 0.05) for name in ("mx", "my")),
    )
    half = Information(coefficients, np.zeros((3, 3)), np.zeros(3), np.array([0.0, 1.0]), watched.sensitivity)
    declared = bench({"drive_gain_u": 0.01, "drive_misalignment_u": 0.01})
    found, closed = (
        {row.source: row for row in budget(estimates(), declared, given).uncertainty} for given in (half, None)
    )
    assert found["drive gain"] == closed["drive gain"]
    assert "the record leaves" in found["drive misalignment"].sensitivity


# ---------------------------------------------------------------------------------------------- the remedy (how-to.md)


def row(source: str, unit: str = "1") -> Contribution:
    return Contribution(source=source, value=0.1, unit=unit, sensitivity="1", contribution_rad=1.0)


@pytest.mark.parametrize("source", ["drive gain", "sense gain ratio", "clock"])
def test_a_gain_error_cancels_in_a_virtual_rotation_that_is_reversed(source: str) -> None:
    turning = bench({}, controller={"virtual_rotation_rad_s": -2.0, "virtual_reversal_s": 0.0})
    # Half a turn takes 1.57 s; of the 8 s that are scored that is three times there and back at least.
    assert f"[controller] virtual_reversal_s = {8.0 / 6.0:.3g}," in remedy(row(source), turning).text
    reversed_already = bench({}, controller={"virtual_rotation_rad_s": 2.0, "virtual_reversal_s": 1.0})
    off = row(source).model_copy(update={"found": True})
    assert f"[device.calibration] {source.replace(' ', '_')}_u" in remedy(off, turning).text
    still = bench({}, controller={"virtual_rotation_rad_s": 0.0, "virtual_reversal_s": 0.0})
    for declared in (reversed_already, still):  # nothing is left to cancel, and a slower rotation tells less
        assert f"[device.calibration] {source.replace(' ', '_')}_u" in remedy(row(source), declared).text


def test_no_remedy_is_a_setting_that_a_plug_in_does_not_read() -> None:
    own = {"plugin": "mine.py:Mine"}
    turning = {"virtual_rotation_rad_s": -2.0, "virtual_reversal_s": 0.0}
    observed, controlled = bench({}, observer=own), bench({}, controller={**own, **turning})
    assert "[device] amplitude_m" in remedy(row("estimation", "rad"), observed).text
    for source in ("drive gain", "undeclared effects"):
        assert not remedy(row(source), controlled).changes


def test_a_rate_that_the_damping_may_add_is_none_that_amplitude_lowers() -> None:
    """¼ of Δd of 0.5 /s over 8 s is the whole of the row; of 0.05 /s it is a tenth, and the rest is noise; so are ½ of
    0.25 /s and of 0.025 /s that a damping is uncertain by."""
    whole, rest = '[controller] mode = "whole_angle"', "[device] amplitude_m"
    for apart, sd, asked in ((0.5, 0.01, whole), (0.05, 0.01, rest), (0.0, 0.25, whole), (0.0, 0.025, rest)):
        device = {"mass_kg": 1e-3, "damping_N_s_per_m": [1e-3 * (1.0 + apart), 1e-3, 0.0]}
        known = {"initial_sd": {"damping": sd}, "process_noise": {"rate_rad_s_per_rts": 0.0}}
        loops = bench({}, device=device, controller={"mode": "force_to_rebalance"}, observer=known)
        assert asked in remedy(row("estimation", "rad"), loops).text


def test_each_row_has_a_remedy_of_its_own() -> None:
    declared = bench({})
    assert "[observer.process_noise] rate_rad_s_per_rts = 0.1 " in remedy(row("estimation", "rad"), declared).text
    constant = bench({}, observer={"process_noise": {"rate_rad_s_per_rts": 0.0}})
    assert "[device] amplitude_m" in remedy(row("estimation", "rad"), constant).text
    further = remedy(row("undeclared effects", "rad"), declared).text
    assert "[controller] virtual_rotation_rad_s = 6, so" in further  # twice that
    fast = bench({}, controller={"virtual_rotation_rad_s": 20.0})  # 2 Ωv ω A = 10 m/s² of twice that, and 10 there are
    assert remedy(row("undeclared effects", "rad"), fast).text.startswith("hil trace")
    still = bench({}, controller={"virtual_rotation_rad_s": 0.0, "virtual_reversal_s": 0.0})
    assert "[controller] virtual_rotation_rad_s = 2.5 and" in remedy(row("undeclared effects", "rad"), still).text
    free = bench({}, controller={"enabled": False})
    assert "control law on" in remedy(row("undeclared effects", "rad"), free).text
    assert "hil trace" in remedy(row("what the model lacks", "rad"), declared).text
    assert "[observer.initial_sd] damping" in remedy(row("declared damping", "1/s"), declared).text
    for source, key in KEYS.items():
        if source not in ("drive gain", "sense gain ratio", "clock"):
            told = remedy(row(source, "s" if "delay" in source else "1"), declared).text
            assert told.endswith(f"[device.calibration] {key}")


@pytest.mark.parametrize("source", ["drive gain", "clock", "estimation", "undeclared effects"])
@pytest.mark.parametrize("turned", [{"virtual_rotation_rad_s": 2.0}, {"virtual_rotation_rad_s": 0.0}])
@pytest.mark.parametrize("back", [0.0, 1.0])
def test_a_setting_that_is_proposed_is_one_of_a_bench_file(source: str, turned: dict[str, float], back: float) -> None:
    """Each value of the words is that of the settings, and a bench file takes them."""
    declared = bench({}, controller=turned | {"virtual_reversal_s": back if turned["virtual_rotation_rad_s"] else 0.0})
    found = remedy(row(source, "rad" if source in ("estimation", "undeclared effects") else "1"), declared)
    if found.calibrates:
        assert (found.calibrates, found.changes) == (KEYS[source], {})
        return
    again = override(declared, dict(found.changes), "the proposal")
    assert again != declared
    for keys in found.changes.values():
        for key, value in keys.items():
            (name, number), *_ = value.items() if isinstance(value, dict) else [(key, value)]
            assert f"{name} = {number:g}" in found.text or (name in found.text and f"such as {number:g}" in found.text)


def test_a_row_says_how_it_comes_about_in_figures() -> None:
    """The damping of both axes, in two figures, without that between them, however large it is."""
    found = estimates(dxy_per_s=1.0)
    told = made({"drive_misalignment_u": 1e-3}, found)["drive misalignment"].sensitivity
    quarter = quantity(math.hypot(DXX, DYY) / 4.0, "rad/s", 2)
    assert f"a quarter of the damping, {quarter} of both" in told
    assert quarter not in (
        quantity(math.hypot(DXX, DYY) / 4.0, "rad/s", 4),
        quantity(math.hypot(DXX, DYY, 1.0) / 4.0, "rad/s", 2),
    )
