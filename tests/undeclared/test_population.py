"""Which records there are, and that one order is one record."""

import json
from pathlib import Path

import numpy as np
import pytest

from device_emulator.effects.kinds import DECLARATIONS
from evaluation.undeclared.device import draw_device
from evaluation.undeclared.effects import BEYOND, DRAWABLE, EFFECTS
from evaluation.undeclared.population import SHARES, Order, kinds, population
from evaluation.undeclared.record import draw_record, make, recorded
from hil.bench import load_bench
from hil.records.capture import read_capture


def test_a_larger_population_keeps_the_records_of_a_smaller_one() -> None:
    small, large = population(120), population(480)
    assert {order.name for order in small} <= {order.name for order in large}
    assert len({order.seed for order in large}) == len(large)


def test_every_category_and_every_effect_is_there() -> None:
    orders = population(480)
    assert {order.category for order in orders} == set(SHARES)
    assert sum(order.category == "clean" for order in orders) >= 100
    for category in ("single", "outside", "double", "calm", "never"):
        assert {order.effects for order in orders if order.category == category} == set(kinds(category))
    assert len([order for order in orders if order.category == "single"]) >= 200


def test_the_first_records_are_a_fair_sample() -> None:
    first = population(480)[:60]
    for category, share in SHARES.items():
        assert sum(order.category == category for order in first) == pytest.approx(60 * share, abs=2)


@pytest.mark.moderate
def test_effects_go_beyond_practice_and_some_are_on_one_axis_alone() -> None:
    rng = np.random.default_rng(5)
    device = draw_device(rng, crest=1.3, slow=False)
    for name, symbols in (
        ("drive_gain", ("hx", "hy")),
        ("cubic_stiffness", ("k3x", "k3y")),
        ("drive_delay", ("tux", "tuy")),
    ):
        drawn = [DRAWABLE[name].draw(rng, device) for _ in range(600)]
        sizes = np.array([one.size for one in drawn])
        both = np.array([[one.effects[0][symbol] for symbol in symbols] for one in drawn])
        alone = np.mean((both == 0.0).any(axis=1))
        assert alone == pytest.approx(1.0 / 3.0, abs=0.06)  # three standard deviations of 600
        assert DRAWABLE[name].high < sizes.max() <= BEYOND * DRAWABLE[name].high
        assert sizes.min() >= DRAWABLE[name].low
    clipping = [DRAWABLE["sense_clipping"].draw(rng, device).size for _ in range(100)]
    assert max(clipping) <= 0.99  # a level: there is nothing beyond


def test_what_is_hidden_is_known_to_the_emulator() -> None:
    names = set(DECLARATIONS)
    order = next(order for order in population(480) if order.effects == ("parasitic_mode",))
    assert order.category in SHARES
    assert len(EFFECTS) > len(DRAWABLE) > 20
    assert {"stick_slip_support", "backlash", "hysteretic_stiffness", "telegraph_offset", "nonlinear_coupling"} <= names


@pytest.mark.slow
def test_one_order_one_record(tmp_path: Path) -> None:
    """The same bytes again; a record that is there is not made anew; a thermometer only where one is."""
    order = next(order for order in population(480) if order.effects == ("temperature_offset",))
    first = make(order, tmp_path / "first", 3000)
    second = make(order, tmp_path / "second", 3000)
    for name in ("capture.arrow", "bench.toml", "truth.json"):
        assert (first / name).read_bytes() == (second / name).read_bytes()
    (first / "capture.arrow").unlink()
    make(order, tmp_path / "first", 3000)
    assert not (first / "capture.arrow").exists()
    capture, bench = read_capture(second / "capture.arrow"), load_bench(second / "bench.toml")
    assert len(capture) == 3000
    assert capture.temp_C is not None
    assert capture.temp_C[0] == 25.0
    truth = json.loads((second / "truth.json").read_text())
    declared, true = bench.device.stiffness_per_s2, truth["device"]["stiffness_per_s2"]
    assert all(0.0 < abs(a / b - 1.0) <= 0.0201 for a, b in zip(declared[:2], true[:2], strict=True))
    assert not bench.effects.named
    assert not bench.effects.custom


@pytest.mark.slow
def test_calm_records_have_neither_dither_nor_modulation(tmp_path: Path) -> None:
    orders = population(480)
    calm = make(next(order for order in orders if order.category == "calm"), tmp_path, 500)
    excited = make(next(order for order in orders if order.category == "single"), tmp_path, 500)
    assert load_bench(calm / "bench.toml").controller.dither_mps2 == 0.0
    assert load_bench(calm / "bench.toml").controller.amplitude_modulation == 0.0
    controller, device = load_bench(excited / "bench.toml").controller, load_bench(excited / "bench.toml").device
    k = sum(device.stiffness_per_s2[:2]) / 2
    assert controller.amplitude_modulation == 0.3
    assert controller.dither_mps2 >= 2e-3 * k * device.amplitude_m
    assert controller.virtual_rotation_rad_s > 0.0


@pytest.mark.moderate
def test_a_device_that_passes_its_converter_is_drawn_again(tmp_path: Path) -> None:
    """A cubic sense and interference that are together beyond the range: the record of draw 91 that was refused."""
    order = Order("double", ("sense_cubic", "interference"), 0, 91)
    first = recorded(draw_record(order, 3000), order, 3000)
    assert np.count_nonzero(first.capture[:, 5] & 2) > 0
    truth = json.loads((make(order, tmp_path, 3000) / "truth.json").read_text())
    assert truth["drawn_before"] >= 1
    assert truth["rows_clipped"] == 0
    assert [effect["name"] for effect in truth["effects"]] == ["sense_cubic", "interference"]
