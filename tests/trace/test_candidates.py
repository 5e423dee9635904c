"""What is tried beside a model, and where it begins."""

import numpy as np
import pytest

from estimator.trace.filtered import Filtered
from estimator.trace.likelihood import Model
from estimator.trace.problem import Effects
from tests.trace.plain import problem, records


def tried(included: Effects) -> Effects:
    sense, drive = records(1, 1500)
    of = Filtered(problem(sense[0], drive[0]))
    layout = of.layout(included)
    model = Model(included, layout.mean, of.declared_noise())
    return of.candidates(model, of.evaluate(layout, model))


@pytest.mark.parametrize(
    ("name", "given", "other"),
    [
        ("interference:1", {"omega": 777.0}, "base_vibration"),
        ("base_vibration:2", {"omega": 777.0}, "interference"),
        ("dry_friction:1", {"v0": 3e-3}, "dry_friction_asymmetric"),
    ],
)
def test_what_is_searched_for_alike_begins_where_the_included_effect_is(
    name: str, given: dict[str, float], other: str
) -> None:
    """A line that is explained is in no residual any more, and a line of the other kind may still be in its place."""
    found = tried({name: given})
    assert found[f"{other}:for {name}"] == pytest.approx(given)
    assert name not in found
    assert not any(key.startswith(f"{name.partition(':')[0]}:for") for key in found)


def test_nothing_begins_there_that_is_searched_for_otherwise() -> None:
    found = tried({"interference:1": {"omega": 777.0}, "sense_delay": {}})
    assert [key for key in found if "for " in key] == ["base_vibration:for interference:1"]
    assert np.all([key.partition(":")[0] != "sense_delay" for key in found])
