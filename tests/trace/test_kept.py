"""Passes and parts of a record that a search asks for again; lines that several effects depend on."""

import numpy as np

from estimator.observer import Observer
from estimator.settings import ObserverSettings
from estimator.trace.kept import PASSES
from tests.estimator.gyro_loop import Truth
from tests.trace.test_pass import Case, model_of


def test_a_pass_is_made_once_and_forgotten_after_many_others() -> None:
    of, _, _ = Case().made()
    model = model_of(of, {})
    layout = of.layout({})
    first = of.evaluate(layout, model)
    assert of.evaluate(layout, model) is first
    assert of.evaluate(layout, model, derivatives=False) is first
    other = model_of(of, {})
    other.theta[0] += 0.01
    without = of.evaluate(layout, other, derivatives=False)
    seen = of.evaluate(layout, other)
    assert seen is not without
    np.testing.assert_array_equal(seen.innovation, without.innovation)
    assert of.part(slice(0, 100)) is of.part(slice(None, 100))
    assert of.part(slice(0, of.samples + 5)) is of
    kept = of._kept
    for k in range(PASSES):
        kept.evaluation(k, True, lambda: first)
    again = of.evaluate(layout, model)
    assert again is not first
    np.testing.assert_array_equal(again.information, first.information)


def test_a_line_is_followed_once_for_all_effects_that_depend_on_it() -> None:
    one, other = {"omega": 1300.0}, {"omega": 1500.0}
    effects = {"interference:1": one, "base_vibration:1": one, "base_vibration:2": other}
    settings = Observer(Truth().device(), ObserverSettings(effects=effects), watched=2).arrays.settings[0]
    alone = Observer(Truth().device(), ObserverSettings(effects={"interference:1": one})).arrays.settings[0]
    assert settings["signal_count"] == 2 * alone["signal_count"]
    first, second, third = settings["effects"][:3, 2]
    assert first == second != third
    assert settings["carried_signals"] == alone["signal_count"] == alone["carried_signals"]
