"""The observer of the averaged motion beside the thirteen states, on records of a gyro that turns freely."""

import math
import tomllib

import numpy as np
import pytest

from hil.bench import examples, load_bench, override
from hil.toml.reading import toml_value
from tests.plugins.direct import Driven, drive_directly, observed

RATE_RAD_S, RATE_HZ, SETTLED = 2.0, 1e5, 120_000
TRUTH = {"kxx": 987_947_400.0, "kyy": 985_973_500.0, "kxy": 592_200.0, "dxx": 3.2987, "dyy": 2.9845, "dxy": 0.07854}
BENCH = override(
    load_bench(examples.find("bench", "s-modern-5k")),
    {
        "loop": {"mode": "force"},
        "controller": {"mode": "classic_whole_angle", "virtual_rotation_rad_s": 0.0, "dither_mps2": 0.0},
    },
    "test",
)
REPLAYED = override(BENCH, {"controller": {"mode": "whole_angle", "enabled": False}}, "test")


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Driven:
    """A 5 kHz gyro of 100 kS/s, from rest, at a constant rate."""
    table = tomllib.loads(examples.find("scenario", "s-modern-5k").read_text(encoding="utf-8"))
    table["rate"] = {"kind": "constant", "rate_rad_s": RATE_RAD_S}
    table["truth"]["position_m"] = [0.0, 0.0]
    lines = [f"seed = {table.pop('seed')}"]
    for section, keys in table.items():
        lines += [f"[{section}]", *(f"{key} = {toml_value(value)}" for key, value in keys.items())]
    path = tmp_path_factory.mktemp("slow") / "board.toml"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return drive_directly(BENCH, path, 2.4)


def error_rad(plugin: str | None, record: Driven) -> float:
    """Rms of the angle's error in the second half, whatever it was at its begin."""
    found = observed(REPLAYED, plugin, record, 100)
    late = found.index[found.index > SETTLED]
    return float(np.std(found.angle[late] - RATE_RAD_S * late / RATE_HZ))


@pytest.mark.slow
def test_its_angle_is_nearly_that_of_the_thirteen_states(record: Driven) -> None:
    assert error_rad("slow_flow", record) < 1.5 * error_rad(None, record)


@pytest.mark.slow
def test_it_finds_what_the_device_is_and_its_residual_is_white(record: Driven) -> None:
    found = observed(REPLAYED, "slow_flow", record, 100)
    blocks = found.innovation[SETTLED + 99 :: 100, 0] / found.innovation_deviation[SETTLED + 99 :: 100, 0]
    assert np.std(blocks) == pytest.approx(1.0, abs=0.1)
    assert abs(np.mean(blocks[1:] * blocks[:-1])) < 4.0 / math.sqrt(len(blocks))
    for name, value in TRUTH.items():
        off = found.state[-1, found.names.index(name)] - value
        if name.startswith("d"):
            assert abs(off) < 4.0 * found.deviation[-1, found.names.index(name)], name
        assert abs(off) < (1e-7 * TRUTH["kxx"] if name.startswith("k") else 0.05 * max(value, 0.5)), name


@pytest.mark.slow
def test_its_uncertainty_covers_its_error(record: Driven) -> None:
    found = observed(REPLAYED, "slow_flow", record, 100)
    index = found.index[found.index > SETTLED]
    error = found.angle[index] - RATE_RAD_S * index / RATE_HZ
    assert np.max(np.abs(error - error[0])) < 3.0 * found.angle_deviation[index[-1]]
