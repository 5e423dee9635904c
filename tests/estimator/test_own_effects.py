"""Effects of one's own in the observer: the same numbers as the catalogue's of the same form, derivatives against
differences, code kept by what it consists of.
"""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from estimator.completeness.turning import followed
from estimator.core import compiler, own
from estimator.custom import Coefficient, Declaration, Parameter
from estimator.custom.building import built
from estimator.effects.catalogue import effect_for
from estimator.effects.declaration import Effect
from estimator.errors import ModelError
from estimator.model.catalogue import model_for
from estimator.observer import Observer
from estimator.record import Record
from estimator.scaling import Scaling
from estimator.settings import ControllerSettings, Device, ObserverSettings
from estimator.simulation import simulate
from estimator.trace.candidates import candidates
from estimator.trace.problem import Effects, Problem
from tests.estimator.test_effects import OMEGA0, device

AMPLITUDE, SAMPLES = 1e-4, 400
CONTROLLER = ControllerSettings(latency=1, force_quantum=1e-4, force_limit=10.0, sense_quantum=1e-6, dither=0.1)
CUBIC = {"p": Coefficient("1/(m²·s²)"), "q": Coefficient("1/(m²·s²)")}

# Of each form one of the catalogue and the same as text; coefficients in the catalogue's order.
ALIKE: dict[str, tuple[Declaration, dict[str, float]]] = {
    "cubic_stiffness": (
        Declaration("mine", force=("-p * x**3", "-q*y**3"), coefficients=CUBIC),
        {"p": 1e13, "q": 3e12},
    ),
    "cubic_isotropic": (
        Declaration("mine", force=("-p*r**2*x", "-p*r**2*y"), coefficients={"p": Coefficient("1/(m²·s²)")}),
        {"p": 5e12},
    ),
    "cubic_damping": (
        Declaration(
            "mine", force=("-p*vx**3", "-q * vy**3"), coefficients={"p": Coefficient("s/m²"), "q": Coefficient("s/m²")}
        ),
        {"p": 2e3, "q": -1e3},
    ),
    "dry_friction": (
        Declaration(
            "mine",
            force=("-p*sign(vx)", "-q*sign(vy)"),
            coefficients={"p": Coefficient("m/s²", positive=True), "q": Coefficient("m/s²", positive=True)},
        ),
        {"p": 1.0, "q": 0.6},
    ),
    "drive_gain": (
        Declaration("mine", force=("p*ux", "q*uy"), coefficients={"p": Coefficient("1"), "q": Coefficient("1")}),
        {"p": 0.03, "q": -0.02},
    ),
    "sense_quadratic": (
        Declaration(
            "mine", sense=("p*x**2", "q * y**2"), coefficients={"p": Coefficient("1/m"), "q": Coefficient("1/m")}
        ),
        {"p": 100.0, "q": 30.0},
    ),
    "temperature_stiffness": (
        Declaration(
            "mine",
            force=("-T * (p*x + n*y)", "-T * (n*x + q*y)"),
            coefficients={name: Coefficient("1/(s²·K)") for name in "pqn"},
        ),
        {"p": 1e3, "q": -2e3, "n": 3e2},
    ),
    "base_vibration": (
        Declaration(
            "mine",
            force=("p*cos(w*t) + q*sin(w*t)", "m*cos(w*t) + n*sin(w*t)"),
            coefficients={name: Coefficient("m/s²") for name in "pqmn"},
            parameters={"w": Parameter("1/s", 0.7 * OMEGA0)},
        ),
        {"p": 0.5, "q": -0.3, "m": 0.2, "n": 0.1},
    ),
}


def scaling() -> Scaling:
    return Observer(device(), ObserverSettings()).scaling


def with_own(declared: Declaration, axes: int = 2, of: Device | None = None) -> Device:
    made = of or device(axes)
    own_scaling = Scaling(OMEGA0, made.amplitude, made.sense_gain)
    return replace(made, own=(built(declared, own_scaling, axes),))


def both(name: str, controller: ControllerSettings | None = None) -> tuple[Observer, Observer]:
    """Observers with the catalogue's effect and with the same as text, the same coefficients in both."""
    declared, values = ALIKE[name]
    _, effect = effect_for(name, 2)
    symbols = [c.name for c in effect.coefficients]
    theirs = dict(zip(symbols, values.values(), strict=True))
    if any(p.default is None for p in effect.parameters):
        theirs |= {p.name: next(iter(declared.parameters.values())).value for p in effect.parameters}
    ours = Observer(with_own(declared), ObserverSettings(effects={"mine": {**declared.start, **values}}), controller)
    built_in = Observer(device(), ObserverSettings(effects={name: theirs}), controller)
    spread = [c.plausible for c in effect.coefficients]  # initial values of the same size
    for row, plausible in enumerate(spread, start=13):
        for covariance in (ours.arrays.p, ours.arrays.c):
            covariance[row, row] = plausible**2
    ours.arrays.spread[9:] = np.square(spread)
    ours.arrays.prior[9:] = built_in.arrays.prior[9:]
    return ours, built_in


def record() -> tuple[np.ndarray, np.ndarray]:
    """Volts and drives of something that vibrates."""
    rng = np.random.default_rng(5)
    t = np.arange(SAMPLES) / 4000.0
    sense = -890.0 * AMPLITUDE * np.stack([np.cos(OMEGA0 * t), 0.4 * np.sin(OMEGA0 * t + 0.3)], axis=1)
    return sense + 1e-4 * rng.standard_normal((SAMPLES, 2)), rng.choice([-1.0, 1.0], (SAMPLES, 2))


@pytest.mark.moderate
@pytest.mark.parametrize("name", ALIKE)
def test_a_law_as_text_runs_like_the_same_in_the_catalogue(name: str) -> None:
    ours, theirs = both(name)
    sense, drive = record()
    warmth = 20.0 + np.linspace(0.0, 3.0, SAMPLES)
    found, known = (one.run(sense, drive, temperature=warmth) for one in (ours, theirs))
    start = np.array(list(ALIKE[name][1].values()))
    assert not np.allclose(found.state[-1, 13:], start, rtol=1e-6)  # it was estimated
    size = np.abs(known.state).max(axis=0)
    np.testing.assert_allclose(found.state / size, known.state / size, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(found.deviation, known.deviation, rtol=1e-6)
    np.testing.assert_allclose(found.innovation, known.innovation, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(found.angle, known.angle, atol=1e-9)


@pytest.mark.parametrize("name", ["cubic_stiffness", "dry_friction", "drive_gain"])
def test_the_control_law_undoes_it_alike(name: str) -> None:
    ours, theirs = both(name, CONTROLLER)
    sense, drive = record()
    for (zx, zy), (ux, uy) in zip(sense[:100], drive, strict=False):
        assert ours.tick(zx, zy, ux, uy) == theirs.tick(zx, zy, ux, uy)
    without = Observer(device(), ObserverSettings(), CONTROLLER)
    commands = [without.tick(zx, zy, ux, uy) for (zx, zy), (ux, uy) in zip(sense[:100], drive, strict=False)]
    assert commands[-1] != theirs.tick(*sense[99], *drive[99])


@pytest.mark.slow
def test_the_angle_moves_with_it_alike() -> None:
    declared, _ = ALIKE["cubic_stiffness"]
    sense, drive = record()
    whole = Record(sense, drive[:, :, None], np.full(SAMPLES, 1 / 4000.0))
    _, ours = followed(Problem(whole, with_own(declared), ObserverSettings()), {"mine": {}})
    _, theirs = followed(Problem(whole, device(), ObserverSettings()), {"cubic_stiffness": {}})
    assert np.any(theirs != 0.0)
    np.testing.assert_allclose(ours, theirs, rtol=1e-9)


def test_a_free_run_has_it_too() -> None:
    declared, values = ALIKE["cubic_stiffness"]
    _, drive = record()
    runs = []
    for made, name, given in (
        (with_own(declared), "mine", values),
        (device(), "cubic_stiffness", {"k3x": 1e13, "k3y": 3e12}),
    ):
        observer = Observer(made, ObserverSettings(effects={name: given}))
        state = observer.state
        state[:4] = [1e-4, 0.0, 0.0, 0.05]
        runs.append(simulate(observer, state, drive, sensitive=True))
    np.testing.assert_allclose(runs[0].sensed, runs[1].sensed, rtol=1e-9)
    np.testing.assert_allclose(runs[0].sensitivity, runs[1].sensitivity, rtol=1e-7, atol=1e-20)


@pytest.mark.slow
@pytest.mark.parametrize(
    "law",
    [
        "-q * x * r**4 / amplitude**4",
        "-q * vx * v / (amplitude * omega0) * omega0**-1",
        "-q * x * cos(4 * orientation)",
        "-q * x * sin(2 * phase) * tanh(y / amplitude)",
        "-q * abs(x) * sqrt(abs(x) / amplitude)",
        "-q * x * exp(-t * omega0 / 100) * (1 + rate / omega0)",
        "-q * x / (2 - x / amplitude)**2 + q * ux * y / (amplitude * omega0**2)",
        "-x * sin(q / omega0**2)*omega0**2",
    ],
)
def test_its_derivatives_are_those_of_the_simulated_motion(law: str) -> None:
    """Sensitivities of a free run to the first state and to the coefficient, against differences of free runs."""
    declared = Declaration("mine", force=(law, ""), coefficients={"q": Coefficient("1/s²")})
    observer = Observer(with_own(declared), ObserverSettings(effects={"mine": {"q": 0.03 * OMEGA0**2}}))
    _, drive = record()
    drive = drive[:60]
    state = observer.state
    state[:4] = [0.8e-4, 0.02, -0.3e-4, 0.05]
    whole = simulate(observer, state, drive, sensitive=True)
    for index in (0, 1, 2, 3, 13):
        step = 1e-5 * observer.factors[index]
        sides = []
        for side in (-1.0, 1.0):
            moved = state.copy()
            moved[index] += side * step
            sides.append(simulate(observer, moved, drive).sensed)
        slope = (sides[1] - sides[0]) / (2.0 * step)
        found = whole.sensitivity[:, :, index]
        np.testing.assert_allclose(found, slope, rtol=0, atol=2e-4 * np.abs(slope).max())


def test_a_sensed_voltage_is_of_its_own_axis() -> None:
    made = replace(device(), sense_gain=(-890.0, 500.0))
    declared = Declaration("mine", sense=("q * x**2", "q * y**2"), coefficients={"q": Coefficient("V/m²", start=3e5)})
    observer = Observer(with_own(declared, of=made), ObserverSettings(effects={"mine": declared.start}))
    state = observer.state
    state[:4] = [0.5e-4, 0.0, 0.8e-4, 0.0]
    plain = Observer(made, ObserverSettings())
    bare = plain.state
    bare[:4] = state[:4]
    added = simulate(observer, state, np.zeros((1, 2))).sensed - simulate(plain, bare, np.zeros((1, 2))).sensed
    np.testing.assert_allclose(added[0], [3e5 * 0.25e-8, 3e5 * 0.64e-8], rtol=1e-9)


@pytest.mark.moderate
def test_a_single_axis_keeps_what_acts_on_it() -> None:
    declared = Declaration("mine", force=("-q * x * r**2", ""), coefficients={"q": Coefficient("1/(m²·s²)")})
    ours = Observer(with_own(declared, 1), ObserverSettings(effects={"mine": {"q": 1e13}}))
    theirs = Observer(device(1), ObserverSettings(effects={"cubic_stiffness": {"k3x": 1e13}}))
    sense, drive = record()
    found, known = (one.run(sense[:, :1], drive[:, :1]) for one in (ours, theirs))
    np.testing.assert_allclose(found.innovation, known.innovation, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize(
    ("force", "complaint"),
    [
        (("", "-q * x"), "force_y: the device has a single axis"),
        (("-q * y", ""), "force_x: a single axis has no 'y'"),
        (("-q * x * rate / omega0", ""), "force_x: a single axis has no 'rate'"),
        (("-q * x * cos(2*orientation)", ""), "force_x: a single axis has no 'orientation'"),
    ],
)
def test_a_single_axis_has_no_other(force: tuple[str, str], complaint: str) -> None:
    declared = Declaration("mine", force=force, coefficients={"q": Coefficient("1/s²")})
    with pytest.raises(ModelError, match=complaint):
        with_own(declared, 1)


@pytest.mark.parametrize(
    ("law", "symbol", "complaint"),
    [
        ("-kxx * x", "kxx", "coefficients.kxx: the base model has a constant of that name"),
        ("-q * x * 0", "q", "coefficients.q: falls out"),
        ("q * x / (x - x) * amplitude", "q", "divides by zero"),
    ],
)
def test_what_would_be_no_effect_is_refused(law: str, symbol: str, complaint: str) -> None:
    declared = Declaration("mine", force=(law, ""), coefficients={symbol: Coefficient("1/s²")})
    with pytest.raises(ModelError, match=complaint):
        with_own(declared)


@pytest.mark.slow
def test_a_name_that_is_a_word_of_the_generated_code_is_as_good_as_any() -> None:
    for symbol in ("c", "s", "math", "value", "_t0"[1:], "first", "own_q"):
        declared = Declaration("mine", force=(f"-{symbol} * x", ""), coefficients={symbol: Coefficient("1/s²")})
        observer = Observer(with_own(declared), ObserverSettings(effects={"mine": {symbol: 1.0}}))
        assert observer.names[-1] == symbol
        observer.run(*record())


@pytest.mark.moderate
def test_code_is_kept_by_what_it_consists_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GYROHIL_CACHE", str(tmp_path))
    monkeypatch.setattr(own, "_known", {})
    _, model = model_for(2)

    def effect(name: str, law: str, symbol: str) -> Effect:
        return built(Declaration(name, force=(law, ""), coefficients={symbol: Coefficient("1/s²")}), scaling(), 2)

    first = effect("mine", "-q * x / 3", "q")
    assert not own.is_compiled(first, model)
    place = own.address(first, model)
    assert own.is_compiled(first, model)
    assert own.address(effect("other", "-q*x/3", "q"), model) == place  # another name, the same law
    changed = effect("mine", "-q * x / 4", "q")
    assert not own.is_compiled(changed, model)
    assert own.address(changed, model) != place
    monkeypatch.setattr(own, "_known", {})  # as in another process
    assert own.is_compiled(first, model)
    assert len(list((tmp_path / "own").glob("*.so"))) == 2


def test_without_a_compiler_one_line_names_both_cures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GYROHIL_CACHE", str(tmp_path))
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr(compiler, "find_spec", lambda name: None)
    _, model = model_for(2)
    law = Declaration("mine", force=("-q * x / 5", ""), coefficients={"q": Coefficient("1/s²")})
    cures = r"^effect mine: no C compiler: .*apt install gcc.*pip install 'gyrohil\[compiler\]'$"
    with pytest.raises(ModelError, match=cures):
        own.address(built(law, scaling(), 2), model)


def test_a_compiler_that_fails_is_told_with_its_word(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    broken = tmp_path / "cc"
    broken.write_text("#!/bin/sh\necho 'cc: fatal error: out of wits' >&2\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setenv("GYROHIL_CACHE", str(tmp_path))
    monkeypatch.setenv("CC", str(broken))
    _, model = model_for(2)
    law = Declaration("mine", force=("-q * x / 6", ""), coefficients={"q": Coefficient("1/s²")})
    with pytest.raises(ModelError, match=r"^effect mine: .*out of wits"):
        own.address(built(law, scaling(), 2), model)
    assert not list((tmp_path / "own").iterdir())  # nothing half made


@pytest.mark.slow
def test_a_candidate_of_a_trace_is_tried_at_its_values() -> None:
    declared = Declaration(
        "mine",
        force=("-q * x * tanh(x / s0)", ""),
        coefficients={"q": Coefficient("1/s²")},
        parameters={"s0": Parameter("m", 1e-5, (1e-6, 1e-5, 1e-4))},
    )
    sense, drive = record()
    whole = Record(sense, drive[:, :, None], np.full(SAMPLES, 1 / 4000.0))
    seen: Any = SimpleNamespace(innovation=sense, deviation=np.ones_like(sense))

    def tried(of: Device) -> Effects:
        return candidates(Problem(whole, of, ObserverSettings()), {}, seen)

    mine = tried(with_own(declared))
    assert [mine[f"mine:{label}"]["s0"] for label in (1, 2, 3)] == pytest.approx([1e-6, 1e-5, 1e-4])
    assert tried(with_own(ALIKE["cubic_stiffness"][0]))["mine"] == {}


@pytest.mark.moderate
def test_a_law_may_have_many_parameters_and_a_signal() -> None:
    names = ("w", "s0", "v_a")
    declared = Declaration(
        "mine",
        force=("q * cos(w * t) * tanh(x / s0) * tanh(vx / v_a) * sign(vx)", ""),
        coefficients={"q": Coefficient("m/s²")},
        parameters=dict(
            zip(names, (Parameter("1/s", 900.0), Parameter("m", 1e-5), Parameter("m/s", 0.1)), strict=True)
        ),
    )
    observer = Observer(with_own(declared), ObserverSettings(effects={"mine": {**declared.start, "q": 0.5}}))
    assert np.all(np.isfinite(observer.run(*record()).state))
