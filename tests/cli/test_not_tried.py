"""docs/reference/trace.md, `reasons`: where something is left, a trace says what it did not try."""

from estimator.effects.catalogue import EFFECTS
from estimator.settings import Device
from hil.tracing.also import effects_asked, not_tried

TWO = Device(4000.0, (1.6e6, 1.6e6, 0.0), (1.0, 1.0, 0.0), 1e-4, (-890.0, -890.0), (1e-4, 1e-4))
ONE = Device(4000.0, (1.6e6,), (1.0,), 1e-4, (-890.0,), (1e-4,))
WITH_MEMORY = {"hysteretic_stiffness", "play", "free_mode"}


def words(sentence: str) -> set[str]:
    return set(sentence.replace(",", " ").replace(";", " ").split())


def test_effects_on_request_are_told_as_the_option_takes_them() -> None:
    option = not_tried(ONE, ())[0].partition("--also ")[2].split()[0]
    assert set(effects_asked([option], ONE)) == WITH_MEMORY


def test_of_two_axes_nothing_is_left_untried() -> None:
    assert not_tried(TWO, ()) == ()
    assert effects_asked(["drag_radial"], TWO) == ()


def test_of_a_single_axis_what_no_trace_tries_is_named() -> None:
    ruled_out = {"cubic_stiffness", "sense_delay", "interference:2"}
    told = words(not_tried(ONE, ruled_out)[-1])
    assert {"parasitic_mode", "sense_high_pass", "base_vibration"} <= told
    assert not told & {"cubic_stiffness", "sense_delay", "interference", "nonreciprocal_stiffness", *WITH_MEMORY}
    assert not told & {effect.name for effect in EFFECTS if effect.declared_only}
