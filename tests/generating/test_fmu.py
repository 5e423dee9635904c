"""`hil generate --fmu`: a co-simulation unit that FMPy finds valid, and that computes what the bench computes."""

import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import extract, read_model_description
from fmpy.fmi1 import FMICallException
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu

import hil
from estimator.observer import Observer
from hil.bench import Bench, load_bench
from hil.errors import InputError
from hil.generating.c_code import MISSING, Golden, golden
from hil.inputs.declared import board_device_of, controller_settings_of, observer_settings_of
from hil.library.generating import assumed_board
from tests.made_once import made_once

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("no_sizes")]

STEP_S = 1.0 / 4000.0


def declared() -> Bench:
    return load_bench(Path(__file__).parents[2] / "examples" / "s-slow.bench.toml")


@pytest.fixture(scope="module")
def unit(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = made_once(tmp_path_factory, "fmu", lambda out: hil.generate(declared(), out=out, fmu=True))
    return folder / "gyro_estimator.fmu"


@pytest.fixture(scope="module")
def vectors() -> tuple[Observer, Golden]:
    bench = declared()
    identity = assumed_board(bench, 1, None, None)
    observer = Observer(board_device_of(bench), observer_settings_of(bench), controller_settings_of(bench, identity))
    return observer, golden(observer, 1200, 200)


@contextmanager
def running(unit: Path, place: Path) -> Iterator[tuple[Any, dict[str, int]]]:
    """The unit in step mode, and its variables by name."""
    described = read_model_description(str(unit))
    slave = FMU3Slave(
        guid=described.guid, unzipDirectory=extract(str(unit), str(place)), instanceName="one",
        modelIdentifier=described.coSimulation.modelIdentifier,
    )  # fmt: skip
    slave.instantiate()
    slave.enterInitializationMode(startTime=0.0)
    slave.exitInitializationMode()
    try:
        yield slave, {one.name: one.valueReference for one in described.modelVariables}
    finally:
        slave.terminate()
        slave.freeInstance()


def test_fmpy_finds_it_valid_and_it_brings_its_sources(unit: Path) -> None:
    assert validate_fmu(str(unit)) == []
    with zipfile.ZipFile(unit) as packed:
        names = set(packed.namelist())
        inside, beside = packed.read("sources/gyro_estimator.c"), (unit.parent / "gyro_estimator.c").read_bytes()
    assert {
        "modelDescription.xml",
        "sources/fmi3.c",
        "sources/gyro_estimator.h",
        "sources/buildDescription.xml",
    } < names
    assert inside == beside
    described = read_model_description(str(unit))
    units = {one.name: one.unit for one in described.modelVariables}
    assert (units["sense_x"], units["drive_x"], units["angle"], units["kxx"]) == ("V", "m/s2", "rad", "1/s2")


def test_it_computes_what_the_bench_computes(unit: Path, vectors: tuple[Observer, Golden], tmp_path: Path) -> None:
    observer, expected = vectors
    volts, force = observer.sense_quantum, observer.drive_quantum
    with running(unit, tmp_path) as (slave, names):
        inputs = [names[name] for name in ("sense_x", "sense_y", "applied_x", "applied_y")]
        outputs = [names[name] for name in ("drive_x", "drive_y", "angle")]
        found = np.zeros((len(expected.angle), 3))
        for m in range(len(found)):
            sensed = np.where(expected.sense[m] == MISSING, np.nan, expected.sense[m] * volts)
            applied = expected.applied[m] * force
            slave.setFloat64(inputs, [*sensed, *applied])
            slave.setBoolean([names["drive_on"]], [m >= expected.quiet])
            slave.doStep(m * STEP_S, STEP_S)
            found[m] = slave.getFloat64(outputs)
        state = slave.getFloat64([names[name] for name in observer.names])
        deviation = np.array(slave.getFloat64([names[f"sd_{name}"] for name in observer.names]))
    np.testing.assert_allclose(found[:, :2] / force, expected.drive[:-1], atol=1e-6)
    np.testing.assert_allclose(found[:, 2], expected.angle, atol=1e-9)
    apart = np.abs(np.array(state) - expected.state) / np.where(deviation > 0.0, deviation, np.inf)
    assert apart.max() < 1e-6


def test_a_saved_state_is_gone_on_from(unit: Path, tmp_path: Path) -> None:
    with running(unit, tmp_path) as (slave, names):
        slave.setFloat64([names["sense_x"]], [0.01])
        slave.doStep(0.0, STEP_S)
        saved = slave.getFMUState()
        slave.doStep(STEP_S, STEP_S)
        once = slave.getFloat64([names["x"], names["angle"]])
        slave.setFMUState(saved)
        slave.doStep(STEP_S, STEP_S)
        assert slave.getFloat64([names["x"], names["angle"]]) == once
        slave.freeFMUState(saved)


def test_a_step_of_another_length_is_refused(unit: Path, tmp_path: Path) -> None:
    with running(unit, tmp_path) as (slave, _), pytest.raises(FMICallException, match="fmi3DoStep"):
        slave.doStep(0.0, 2.0 * STEP_S)


def test_without_a_compiler_one_line_names_the_cures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(InputError) as refusal:
        hil.generate(declared(), out=tmp_path / "out", fmu=True)
    assert "\n" not in str(refusal.value)
    assert "sudo apt install gcc libc6-dev, or pip install 'gyrohil[compiler]'" in str(refusal.value)
