"""A drive declared in m/s², N or V is one drive: what is written to the board, and what comes of it, is the same.

docs/safety.md: no board is asked for more than the bench file declares, in whatever unit it does.
"""

import itertools
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimator.gain_matrix import GainMatrix
from estimator.observer import Observer
from hil.bench import Bench, override
from hil.bench.template import template, values_of
from hil.errors import InputError
from hil.importing.importer import import_record
from hil.inputs.declared import (
    board_device_of,
    board_filter_of,
    controller_settings_of,
    device_of,
    observer_settings_of,
    recorded_device_of,
)
from hil.records.runfolder import RunFolder
from hil.records.summary import summarise
from hil.replaying.replay import replay
from hil.running.process.live_settings import LiveSettings, with_settings
from hil.running.request import RunRequest
from hil.running.run import run
from hil.running.safety import preflight
from hil.wire.messages import Identity
from tests.running import gyro
from tests.running.closed import close_loop, waiting
from tests.running.misbehaving import Board

IDENTITY = Board().identity
GAIN = {"mode": "gain", "block": 20, "estimate_every": 20}
UNITS = ["mps2", "N", "V"]
NEWTON_PER_V = -2e-3  # of a drive that pushes the other way round: a board's code has the sign of its own force


def drive_in(unit: str, mass_kg: float, largest_mps2: float, newton_per_V: float = NEWTON_PER_V) -> dict[str, Any]:
    """[device.drive] with the same largest drive in that unit."""
    newton = largest_mps2 * mass_kg
    scale = {"mps2": largest_mps2, "N": newton, "V": newton / abs(newton_per_V)}[unit]
    return {"unit": unit, "full_scale": scale} | ({"gain_N_per_V": newton_per_V} if unit == "V" else {})


def bench_in(unit: str, largest_mps2: float = 4.0, duration_s: float = 0.5, **changes: Any) -> Bench:
    """S-slow with that largest drive, declared in that unit."""
    drive = drive_in(unit, 1e-3, largest_mps2)
    return gyro.bench(duration_s, device={"drive": drive}, **changes)


class Registers:
    """Of a board that holds what is written."""

    def __init__(self) -> None:
        self.held: dict[str, float] = {}

    def write_register(self, _: object, name: str, value: float, timeout_s: float) -> None:
        self.held[name] = value

    def read_register(self, _: object, name: str, timeout_s: float) -> float:
        return self.held[name]


def written(bench: Bench, identity: Identity) -> dict[str, float]:
    """The registers of a board of that IDENTITY as `configure` leaves them."""
    registers = Registers()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(preflight, "client", registers)
        preflight.configure(None, identity, bench)  # type: ignore[arg-type]
    return registers.held


def declared_limit(bench: Bench) -> Fraction:
    """What the bench file says, worked out by hand from its own keys, exactly."""
    drive, mass = bench.device.drive, Fraction(bench.device.mass_kg)
    newton = {"mps2": mass, "N": Fraction(1), "V": abs(Fraction(drive.gain_N_per_V or 1))}[drive.unit]
    full_scale = Fraction(drive.full_scale) * newton / mass
    limit = bench.controller.force_limit_mps2
    return full_scale if limit is None else min(full_scale, Fraction(limit))


magnitudes = st.floats(-3.0, 3.0).map(lambda exponent: 10.0**exponent)


@st.composite
def cases(draw: st.DrawFn) -> tuple[Bench, Bench, Identity]:
    """(a bench in any unit, the same in m/s², a board)"""
    unit, mode = draw(st.sampled_from(UNITS)), draw(st.sampled_from(["force", "gain"]))
    mass, largest = 1e-3 * draw(magnitudes), 4.0 * draw(magnitudes)
    newton_per_V = draw(st.sampled_from([-1.0, 1.0])) * draw(magnitudes)
    drive = drive_in(unit, mass, largest, newton_per_V)
    limit = draw(st.none() | magnitudes.map(lambda share: largest * share))
    controller = {"force_limit_mps2": limit, "dither_mps2": draw(st.floats(0.0, 1.0)) * 0.5 * largest}
    springs = {"stiffness_N_per_m": (1.6e6 * mass, 1.55e6 * mass, 1.6e4 * mass), "mass_kg": mass}
    springs |= {"damping_N_s_per_m": (1.3 * mass, 1.2 * mass, 0.0)}
    controller["target_stiffness_N_per_m"] = 1.58e6 * mass
    loop = {"mode": mode, "block": 20, "estimate_every": 20, "duration_s": 0.5, "settle_s": 0.2}
    declared = gyro.bench(device=springs | {"drive": drive}, controller=controller, loop=loop)
    same = override(declared, {"device": {"drive": drive_in("mps2", mass, largest) | {"gain_N_per_V": None}}}, "same")
    codes = draw(st.floats(2.0, 1e7))
    identity = IDENTITY._replace(
        drive_scale_mps2=largest / codes, drive_bits=draw(st.sampled_from([8, 16, 24])), tick_rate_Hz=4000.0
    )
    return declared, same, identity


@settings(max_examples=60, deadline=None)
@given(cases())
def test_nothing_that_is_written_to_a_board_is_beyond_what_is_declared(case: tuple[Bench, Bench, Identity]) -> None:
    bench, same, identity = case
    limit, code = declared_limit(bench), Fraction(identity.drive_scale_mps2)
    converter = 2 ** (identity.drive_bits - 1) - 1
    registers = written(bench, identity)
    largest = Fraction(registers["DRIVE_LIMIT"])
    assert largest * code <= limit
    assert largest == converter or (largest + 1) * code > limit  # and no less than it may be
    assert abs(largest - Fraction(written(same, identity)["DRIVE_LIMIT"])) <= 1  # of a product that was rounded
    if bench.loop.mode == "gain":
        dither = Fraction(registers["DITHER_AMPLITUDE"])
        assert dither * code <= Fraction(bench.controller.dither_mps2)
        assert dither <= largest


@pytest.mark.moderate
@settings(max_examples=25, deadline=None)
@given(cases(), st.lists(st.tuples(*[st.integers(-30000, 30000)] * 2), min_size=8, max_size=8))
def test_no_answer_of_the_loop_is_beyond_it_either(
    case: tuple[Bench, Bench, Identity], codes: list[tuple[int, int]]
) -> None:
    """DRIVE_FORCE codes for whatever the board says it sensed; matrix and bias as those of the same drive in m/s²."""
    bench, same, identity = case
    largest = written(bench, identity)["DRIVE_LIMIT"]
    observers = [
        Observer(board_device_of(one), observer_settings_of(one), controller_settings_of(one, identity))
        for one in (bench, same)
    ]
    for vx, vy in codes:
        for observer in observers:
            answer = observer.tick(vx, vy, 0, 0)
            assert max(map(abs, answer)) <= largest + (observer is observers[1])
    if bench.loop.mode == "gain":
        board = board_filter_of(bench)
        (gain, bias), (other_gain, other_bias) = (
            [part.copy() for part in GainMatrix(observer, board).solve(41, 20)] for observer in observers
        )
        assert gain == pytest.approx(other_gain, rel=1e-6)
        assert bias == pytest.approx(other_bias, rel=1e-6)


def test_a_limit_of_the_controller_beyond_the_full_scale_is_the_full_scale() -> None:
    bench = bench_in("N", 4.0, controller={"force_limit_mps2": 9.0})
    assert written(bench, IDENTITY)["DRIVE_LIMIT"] * IDENTITY.drive_scale_mps2 <= 4.0
    assert float(bench.drive_limit_mps2) == pytest.approx(4.0)


@pytest.mark.moderate
@pytest.mark.parametrize("unit", ["N", "V"])
@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"loop": GAIN},
        {"controller": {"enabled": False}},
        {"controller": {"force_limit_mps2": 1.5, "dither_mps2": 0.1, "virtual_rotation_rad_s": -2.0}},
    ],
    ids=["force", "gain", "open loop", "limit, dither, rotation"],
)
def test_the_same_drive_in_another_unit_is_the_same_run(tmp_path: Path, unit: str, changes: dict[str, Any]) -> None:
    """To the last bit of the record: the same codes went to the board."""
    scenario = gyro.scenario(tmp_path / "board.toml")
    loop = {"duration_s": 0.5, "settle_s": 0.2, "clock": "lockstep", "seed": 7} | changes.get("loop", {})
    usual, other = (
        close_loop(waiting(scenario), bench_in(name, **(changes | {"loop": loop})), tmp_path / name)[0]
        for name in ("mps2", unit)
    )
    assert usual.capture_path.read_bytes() == other.capture_path.read_bytes()
    assert usual.estimates is not None
    assert other.estimates is not None
    for name, column in usual.estimates.columns.items():
        np.testing.assert_allclose(other.estimates[name], column, rtol=1e-9, atol=1e-15, err_msg=name)


@pytest.mark.parametrize("unit", UNITS)
def test_a_setting_of_the_running_loop_is_in_its_own_unit(unit: str) -> None:
    """Dither in m/s², whatever the drive is declared in: the same share of the force in the observer's own scale."""
    bench = bench_in(unit)
    makes = [
        Observer(board_device_of(one), observer_settings_of(one), controller_settings_of(one, IDENTITY))
        for one in (bench, with_settings(bench, {"dither": 0.7}))
    ]
    LiveSettings(makes[0], bench).change({"dither": 0.7})
    begun, changed = (float(observer.arrays.settings["dither"][0]) for observer in reversed(makes))
    assert begun == changed == pytest.approx(0.7 / (bench.device.amplitude_m * bench.target_stiffness_per_s2))


@pytest.mark.slow
@pytest.mark.parametrize("unit", ["N", "V"])
def test_run_replay_and_trace_of_a_board_whose_drive_is_declared_so(tmp_path: Path, unit: str, no_report: None) -> None:
    """A whole run and its closing scan, a replay of its record and a trace of it, by its own bench file."""
    scenario = gyro.scenario(tmp_path / "board.toml")
    results = []
    for name in ("mps2", unit):
        bench = bench_in(name, duration_s=3.0)
        folder = run(RunRequest(bench, f"inproc:{scenario}"), tmp_path / name, progress=lambda _: None).folder
        assert folder is not None
        results.append(RunFolder(folder).result)
    usual, other = results
    assert usual is not None
    assert other is not None
    assert usual.parts is not None
    assert other.parts is not None
    assert other.parts["model"].outcome == usual.parts["model"].outcome == "complete"
    assert other.angle_u_rad == pytest.approx(usual.angle_u_rad, rel=1e-6)
    for name, parameter in usual.parameters.items():
        assert other.parameters[name].value == pytest.approx(parameter.value, rel=1e-9), name
    record = RunFolder(folder).capture_path
    again = RunFolder(replay(record, bench, tmp_path / "again", progress=lambda _: None).folder or tmp_path).result
    assert again is not None
    for name, parameter in usual.parameters.items():
        assert again.parameters[name].value == pytest.approx(parameter.value, rel=1e-3, abs=1.0), name


def test_a_record_in_volts_is_refused_where_no_volt_is_declared(tmp_path: Path) -> None:
    scenario = gyro.scenario(tmp_path / "board.toml")
    capture = close_loop(waiting(scenario), bench_in("mps2", duration_s=0.1), tmp_path / "run")[0].capture
    assert capture is not None
    gains = {unit: recorded_device_of(bench_in(unit), capture).drive_gain for unit in UNITS}
    assert gains == dict.fromkeys(UNITS, 1.0)  # what a board counts in is m/s²
    for unit, other in itertools.product(UNITS, ["mps2", "N"]):
        device = bench_in(unit).device
        assert device.drive_mps2_per(other) == {"mps2": 1, "N": 1 / Fraction(1e-3)}[other]  # type: ignore[arg-type]
    assert bench_in("N").device.drive_mps2_per("V") is None
    with pytest.raises(InputError, match="gain_N_per_V"):
        device_of(bench_in("N"), drive_unit="V")
    table = tmp_path / "volts.csv"
    rows = [f"{m / 4000.0!r},0.001,0.002,0.1,0.2" for m in range(12)]
    table.write_text("\n".join(["t_s,vx_V,vy_V,ux_V,uy_V", *rows, ""]), encoding="utf-8")
    import_record(table, tmp_path / "volts.arrow")
    with pytest.raises(InputError, match=r"drive recorded in V, .* does not tell what a volt does"):
        replay(tmp_path / "volts.arrow", bench_in("N"), tmp_path / "runs", progress=lambda _: None)


@pytest.mark.moderate
def test_parameters_in_newtons_are_those_per_unit_mass_times_the_mass(tmp_path: Path) -> None:
    """[device] normalised = false beside a drive in N (claims 17, 26): the same run, told in N/m and N·s/m."""
    scenario = gyro.scenario(tmp_path / "board.toml")
    found = []
    for unit, normalised in (("mps2", True), ("N", False)):
        bench = override(bench_in(unit), {"device": {"normalised": normalised}}, "test")
        run, counters = close_loop(waiting(scenario), bench, tmp_path / unit)
        run.bench_path.write_text(template(values_of(bench), "For a test."), encoding="utf-8")
        found.append((run.capture_path.read_bytes(), summarise(RunFolder(run.path), counters.board).parameters))
    (record, usual), (other_record, other) = found
    assert record == other_record
    assert usual.keys() == other.keys()
    for name, parameter in usual.items():
        factor = 1e-3 if name[0] in "kd" else 1.0
        assert other[name].value == pytest.approx(factor * parameter.value, rel=1e-9), name
        assert other[name].ci95 == pytest.approx([factor * end for end in parameter.ci95], rel=1e-9), name
    assert {other[name].unit for name in ("kxx", "kyy", "kxy")} == {"N/m"}
    assert {other[name].unit for name in ("dxx", "dyy", "dxy")} == {"N·s/m"}
    assert usual["kxx"].unit == "1/s²"
