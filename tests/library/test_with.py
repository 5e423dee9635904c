"""`bench.with_(…)`: some keys replaced, checked as a whole again."""

import numpy as np

import hil
from tests.library.test_given import refusal


def test_a_bench_is_changed_key_by_key() -> None:
    bench = hil.load_bench("s-slow")
    changed = bench.with_(device={"sense": {"noise_V": 1e-4}}, observer={"initial_sd": {"stiffness": 0.5}})
    assert changed.device.sense == bench.device.sense.model_copy(update={"noise_V": 1e-4})
    assert changed.observer.initial_sd == bench.observer.initial_sd.model_copy(update={"stiffness": 0.5})
    both = bench.with_(effects={"cubic_stiffness": {"k3x": 1e12}}).with_(effects={"cubic_stiffness": {"k3y": 1e11}})
    assert both.effects.named == {"cubic_stiffness": {"k3x": 1e12, "k3y": 1e11}}
    assert bench.effects.named == {}
    assert refusal(lambda: bench.with_(loop=5)).endswith("[loop] expected a table, not 5")  # type: ignore[arg-type]
    assert "loops: no section" in refusal(lambda: bench.with_(loops={}))
    assert "duration_s" in refusal(lambda: bench.with_(loop={"duration_s": -1.0}))
    assert "[effects] expected a table" in refusal(lambda: bench.with_(effects=5))  # type: ignore[arg-type]


def test_an_effect_that_there_is_not_is_refused_at_once() -> None:
    bench = hil.load_bench("s-slow")
    line = refusal(lambda: bench.with_(effects={"cubic_stifness": {}}))
    assert line.endswith("[effects.cubic_stifness]: no such effect; did you mean cubic_stiffness?")
    line = refusal(lambda: bench.with_(effects={"cubic_stiffness": {"k4x": 1.0}}))
    assert "[effects.cubic_stiffness] k4x: no such coefficient; " in line
    own = {"force_x": "c*x**5", "coefficients": {"c": {"unit": "1/(m^4 s^2)"}}}
    assert bench.with_(effects={"custom": {"fifth": own}, "fifth": {"c": 1.0}}).effects.named == {"fifth": {"c": 1.0}}
    twice = {"interference": {"omega": 300.0}, "interference:2": {"omega": 400.0}}
    assert bench.with_(effects=twice).effects.named == twice


def test_numbers_of_numpy_are_numbers() -> None:
    bench = hil.load_bench("s-slow")
    stiffness = np.array(bench.device.stiffness_N_per_m)
    changed = bench.with_(
        loop={"seed": np.int64(20), "duration_s": np.float32(20.0)},
        device={"stiffness_N_per_m": stiffness, "normalised": np.bool_(False)},
    )
    assert (changed.loop.seed, changed.loop.duration_s, changed.device.normalised) == (20, 20.0, False)
    assert changed.device.stiffness_N_per_m == bench.device.stiffness_N_per_m
    assert type(changed.loop.seed) is int
    line = refusal(lambda: hil.run(bench, link="serial:/dev/absent", seed=np.int64(3)))  # type: ignore[arg-type]
    assert "arm=True" in line
