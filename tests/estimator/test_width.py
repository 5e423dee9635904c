"""How many candidates are carried: the leaders, whoever the scan may be wrong about, every kind where much is left."""

from types import SimpleNamespace

import numpy as np
import pytest

from estimator.trace import width
from estimator.trace.criterion import TIE
from estimator.trace.evidence import Evidence
from estimator.trace.look import Look
from estimator.trace.width import (
    hopeful,
    is_small,
    shortlist,
    within_reach,
    worth_finishing,
    worth_following,
    worth_refining,
)

KINDS = [f"kind{n}" for n in range(30)]


def item(name: str, gain: float, scatter: float = 1.0) -> Evidence:
    return Evidence(name, gain, 1, scatter, np.zeros(1), np.ones(1))


def look(*items: Evidence, ratio=1.0, alike=()) -> Look:
    """What a scan shows whose candidates have nothing in common but the pairs in `alike`; ratio:
    innovation over what was predicted.
    """
    n, names = len(items), [one.name for one in items]
    normal = np.eye(n)
    for one, other in alike:
        normal[names.index(one), names.index(other)] = normal[names.index(other), names.index(one)] = 0.99
    seen = SimpleNamespace(
        ratio=ratio,
        columns={one.name: slice(k, k + 1) for k, one in enumerate(items)},
        normal=normal[None],
        plausible=np.ones(len(normal)),
        score=np.sqrt([[one.gain for one in items]]),
    )
    return Look({}, seen, {one.name: one for one in items})


def asked(view: Look, tried, left=0.0, ratio=1.0, keeps=(), calm=False, refused=()):
    behind = Look({}, SimpleNamespace(ratio=ratio), {"any": item("any", left, 50.0)})

    def screened(names, spared):
        return [name for name in names if name in keeps or name in spared]

    return hopeful(view, tried, refused, lambda: behind, screened, calm=calm)


def test_the_error_of_a_gain_is_what_its_coefficient_scatters_by() -> None:
    # The coefficient c of a signature of length s is off by its scatter in units of 1/s; the gain is c² s².
    rng = np.random.default_rng(1)
    length, c, scatter = 50.0, 2.0, 9.0
    found = c + np.sqrt(scatter - 1.0) / length * rng.standard_normal(200_000)
    assert item("a", (c * length) ** 2, scatter).error == pytest.approx(np.std((found * length) ** 2), rel=0.02)
    assert item("a", 100.0, 0.8).error == 0.0


def test_where_the_scan_is_exact_only_those_that_tie_follow_the_leaders() -> None:
    gains = [1000.0, 999.0, 998.0, 997.0, 996.0, 1000.0 - 0.9 * TIE, 1000.0 - 1.1 * TIE]
    view = look(*(item(*pair) for pair in zip(KINDS, gains, strict=False)))
    leaders = asked(view, {})
    assert leaders == KINDS[:5]
    tried = dict(zip(KINDS, gains[:5], strict=False))
    assert asked(view, tried) == ["kind5"]
    assert asked(view, tried | {"kind5": 994.0}) == []


def test_where_the_scan_is_rough_whoever_it_may_be_wrong_about_follows() -> None:
    # One is 8 % behind the best of the leaders, as on a record whose start upsets the scan, but scatters by 137.
    leaders = [item("a", 160_600.0, 1.3), *(item(name, 155_000.0) for name in "bcde")]
    rough, sure = item("rough", 148_900.0, 137.5), item("sure", 149_000.0, 1.5)
    view = look(*leaders, sure, rough)
    tried = {one.name: one.gain for one in leaders}
    assert asked(view, tried) == ["rough"]
    assert asked(view, tried | {"a": 180_000.0}) == []  # so far ahead that no error of the scan makes up for it


@pytest.mark.parametrize(("second", "small"), [(5.0, True), (900.0, False)])
def test_what_is_behind_is_small_only_if_the_largest_of_it_is(second: float, *, small: bool) -> None:
    """Beside a gain of a thousand, with one candidate that promises nothing."""
    behind = look(item("a", 0.1), item("b", second))
    assert is_small(behind, 1000.0) is small


def test_whoever_looks_like_the_best_that_was_carried_follows() -> None:
    # The scan's leader is another than the best, and five others keep what looks like the best from being a leader.
    items = [item("a", 900.0), item("b", 800.0), item("c:1", 700.0), item("d", 600.0), item("e", 590.0)]
    behind = [item("like", 400.0), item("c:2", 390.0), item("other", 380.0)]
    view = look(*items, *behind, alike=[("c:1", "like"), ("c:1", "c:2")])
    tried = {"a": 900.0, "b": 800.0, "c:1": 2000.0, "d": 600.0, "e": 590.0}
    assert asked(view, tried) == ["like"]
    assert asked(view, tried | {"a": 3000.0}) == []
    assert asked(view, tried | {"like": 1999.0}) == []
    assert asked(view, tried | {"like": 1999.0}, calm=True, keeps=["other"]) == ["other"]


def test_a_delay_follows_wherever_a_low_pass_does() -> None:
    gains = [1000.0, 999.0, 998.0, 997.0, 996.0]
    crowd = [item(*pair) for pair in zip(KINDS, gains, strict=False)]
    tried = dict(zip(KINDS, gains, strict=False))
    delay = item("sense_delay", 10.0)
    assert asked(look(*crowd, item("sense_low_pass", 999.5), delay), {})[-1] == "sense_delay"  # among the leaders
    assert asked(look(*crowd, item("sense_low_pass", 995.0), delay), tried) == ["sense_low_pass", "sense_delay"]
    alike = look(*crowd, item("sense_low_pass", 500.0), delay, alike=[(KINDS[0], "sense_low_pass")])
    assert asked(alike, tried) == ["sense_low_pass", "sense_delay"]


def test_one_that_is_refused_does_not_end_the_round() -> None:
    # One that ties with the leaders has no model of the right sign; a short part is asked all the same.
    view = look(*(item(name, 1000.0) for name in KINDS[:6]), item("other", 10.0))
    tried = dict.fromkeys(KINDS[:5], 1000.0)
    assert asked(view, tried) == ["kind5"]
    assert asked(view, tried, refused=["kind5"], calm=True, keeps=["other"]) == ["other"]
    assert asked(view, tried, refused=["kind5", "other"], calm=True, keeps=["other"]) == []


def test_of_a_kind_one_follows() -> None:
    serious = [item("a:1", 99.0), item("b:1", 98.0), item("b:2", 98.0), item("c", 97.0)]
    assert within_reach(serious, ["a:2"], 100.0) == ["b:1", "c"]
    assert within_reach(serious, [], 100.0) == ["a:1", "b:1", "c"]


def crowd(gain: float) -> Look:
    return look(item(KINDS[0], gain), *(item(name, 40.0 - n) for n, name in enumerate(KINDS[1:20])))


@pytest.mark.parametrize(
    ("gain", "left", "ratio", "small"),
    [
        (1000.0, 15.0, 1.0, True),  # chance
        (1000.0, 25.0, 1.0, False),
        (10_000.0, 99.0, 1.0, True),  # a matter for a second effect
        (10_000.0, 101.0, 1.0, False),
        (10_000.0, 0.0, 1.02, True),
        (10_000.0, 0.0, 1.03, False),  # more power than predicted, and nothing that the scan has a name for
    ],
)
def test_every_kind_is_asked_about_where_the_best_leaves_something_and_eight_are_spared(
    gain, left, ratio, small
) -> None:
    view = crowd(gain)
    leaders = shortlist(view.seen, view.serious)
    others = [name for name in KINDS[:20] if name not in leaders]
    assert asked(view, dict.fromkeys(leaders, gain), left, ratio) == ([] if small else others[:8])


def test_the_short_part_may_keep_more_than_the_eight_and_nobody_is_asked_twice() -> None:
    view = crowd(1000.0)
    leaders = shortlist(view.seen, view.serious)
    others = [name for name in KINDS[:20] if name not in leaders]
    tried = dict.fromkeys(leaders, 1000.0)
    assert asked(view, tried, left=500.0, keeps={KINDS[19], others[0]}) == [*others[:8], KINDS[19]]
    assert asked(view, tried | dict.fromkeys(others[:8], 1.0), left=500.0) == []


def test_where_much_is_seen_the_best_of_each_kind_is_carried_though_nothing_is_steady() -> None:
    """A stranger's record: the true effect promised 7,238 and scattered by 458, carried it gained 43,507."""
    rough = [item(f"{kind}{label}", 7000.0 - n, 458.0) for n, (kind, label) in enumerate(
        [("a", ""), ("a", ":2"), ("b", ""), ("c", ""), ("d", ":1"), ("e", ""), ("f", "")]
    )]  # fmt: skip
    far = look(*rough, ratio=1.3)
    tried = {"a": 30_000.0, "b": 43_507.0, "c": 29_000.0, "d:1": 31_762.0, "e": 100.0}
    assert asked(far, tried, keeps=("f",)) == ["f"]
    assert asked(far, tried) == []


def test_of_those_that_are_not_steady_only_who_promises_more_than_chance_is_carried_where_little_is_seen() -> None:
    """A stranger's friction promised 126 of 36,000 samples and scattered by 6, carried it gained 460.  Chance gives the
    best of seven with two coefficients 2 ln (7 · 10⁴) = 22.3.
    """
    gains = {"friction:1": 126.0, "friction:2": 94.0, "law": 101.0, "drag": 22.4, "gain": 22.2, "delay": 20.0, "b": 9.0}
    rough = [item(name, gain, 8.0) for name, gain in gains.items()]
    edge = float(np.sqrt(1.0 + width._SET.power))
    assert asked(look(*rough, ratio=0.999 * edge), {}) == ["friction:1", "law", "drag"]
    assert asked(look(*rough, ratio=1.001 * edge), {}) == ["friction:1", "law", "drag", "gain", "delay"]


def test_nobody_is_carried_where_nothing_is_more_than_chance() -> None:
    assert asked(look(item("a", 5.0), item("b", 4.0)), {}) == []


@pytest.mark.parametrize(("ratio", "asks"), [(1.0, False), (1.02, False), (1.03, True), (12.0, True)])
def test_far_from_small_a_short_part_is_asked_about_every_kind_though_the_best_leaves_nothing(ratio, asks) -> None:
    # On a calm record the best of the leaders may leave nothing, and the true one be among those the scan thinks little
    # of: what the scan stood before tells how rough a guide it is.
    view = look(item("a", 50_000.0), *(item(name, 40_000.0 - n) for n, name in enumerate(KINDS[1:8])), ratio=ratio)
    leaders = asked(view, {})
    others = [name for name in KINDS[1:8] if name not in leaders]
    tried = dict.fromkeys(leaders, 50_000.0)
    assert asked(view, tried, keeps=others[-1:]) == (others[-1:] if asks else [])
    assert asked(view, tried, keeps=others[-1:], calm=True) == others[-1:]
    assert asked(view, tried | {others[-1]: 51_000.0}, keeps=others) == []


@pytest.mark.parametrize("line", ["interference:1", "base_vibration:2"])
def test_a_line_is_not_believed_before_a_short_part_was_asked_about_every_kind(line) -> None:
    view = look(item(line, 900.0), item("law", 300.0), item("other", 200.0))
    leaders = asked(view, {})
    other = next(name for name in ("law", "other") if name not in leaders)
    tried = dict.fromkeys(leaders, 200.0) | {line: 900.0}
    assert asked(view, tried, keeps=["law", "other"]) == [other]
    # Where a law of motion is ahead, nobody else is asked.
    assert asked(view, tried | {"law": 901.0}, keeps=["law", "other"]) == []


def test_what_a_threshold_may_turn_into_is_carried_beside_it() -> None:
    view = look(item("drive_saturation:3", 900.0), *(item(name, 100.0) for name in KINDS[:8]), item("drive_gain", 20.0))
    assert asked(view, {})[-1] == "drive_gain"
    view = look(item("drive_saturation:3", 900.0), *(item(name, 100.0) for name in KINDS[:8]))
    assert "drive_gain" not in asked(view, {})  # it is carried already, or barred


def test_laws_of_damping_are_carried_beside_one_another_whatever_they_promise() -> None:
    """Friction was 514 in truth where the scan promised 178, and damping that falls with the displacement 514."""
    friction = [item("dry_friction:1", 178.0), item("dry_friction:2", 3.0)]
    view = look(item("nonlinear_damping", 520.0), item("cubic_damping", 518.0), item("law", 300.0), *friction)
    leaders = asked(view, {})
    tried = dict.fromkeys(leaders, 300.0) | {"nonlinear_damping": 514.0, "cubic_damping": 514.0}
    assert asked(view, tried) == ["dry_friction:1", "dry_friction:2"]
    assert asked(view, tried | {"dry_friction:1": 530.0, "dry_friction:2": 520.0}) == []
    # Where something else is ahead, they are not asked for.
    assert asked(view, tried | {"law": 600.0}) == []


def test_behind_the_laws_of_damping_every_kind_is_carried_all_the_same() -> None:
    view = look(item("drag", 900.0), item("cubic_damping", 30.0), *(item(name, 29.0) for name in KINDS[:3]))
    leaders = asked(view, {})
    tried = dict.fromkeys(leaders, 900.0) | {"cubic_damping": 800.0}
    others = [name for name in KINDS[:3] if name not in leaders]
    assert others
    assert asked(view, tried, left=500.0) == others


def test_a_law_of_damping_is_improved_that_has_half_of_what_the_best_has() -> None:
    """How slow the mass is where friction turns over decides how much it explains."""
    base = SimpleNamespace(likelihood=1000.0)
    models = {
        name: SimpleNamespace(likelihood=1000.0 + gain)
        for name, gain in {
            "drag": 861.0,
            "dry_friction:1": 350.0,
            "dry_friction:2": 755.0,
            "interference:1": 755.0,
        }.items()
    }
    watched = {
        "drag": {},
        "dry_friction:1": {"v0": 1.0},
        "dry_friction:2": {"v0": 10.0},
        "interference:1": {"omega": 7.0},
    }
    assert worth_refining(models, base, {}, watched) == ["dry_friction:2"]
    without = {name: model for name, model in models.items() if name != "drag"}
    assert worth_refining(without, base, {"drag": 861.0}, watched) == ["dry_friction:2"]
    assert worth_refining(without, base, {"law": 861.0}, watched) == []


@pytest.mark.parametrize(
    ("gains", "tried", "ends"),
    [
        # half of the best gain, or no further behind than 300 of twice the log-likelihood
        ({"drag": 2000.0, "drive_gain": 1001.0, "law": 999.0}, {}, ["drag", "drive_gain"]),
        ({"drag": 2000.0, "drive_gain": 1001.0, "law": 999.0}, {"best": 2010.0}, ["drag"]),
        ({"drag": 400.0, "drive_gain": 101.0, "law": 99.0}, {}, ["drag", "drive_gain"]),
        ({"drag": 10.0, "drive_gain": -20.0, "law": -np.inf}, {}, ["drag", "drive_gain"]),
    ],
)
def test_who_is_far_behind_after_one_pass_is_not_asked_for_another(gains, tried, ends) -> None:
    models = {name: SimpleNamespace(likelihood=1000.0 + gain) for name, gain in gains.items()}
    assert worth_finishing(models, SimpleNamespace(likelihood=1000.0), tried) == ends


def test_who_is_within_a_tenth_of_the_best_gain_has_its_parameters_improved() -> None:
    """Of two of a kind, or with one parameter between them, the better; who has none stays as it is."""
    base = SimpleNamespace(likelihood=1000.0)
    gains = {
        "drive_saturation:1": 95.0, "drive_saturation:2": 97.0, "interference:1": 96.0, "base_vibration:1": 94.0,
        "sense_high_pass:1": 85.0, "drive_gain": 100.0,
    }  # fmt: skip
    models = {name: SimpleNamespace(likelihood=1000.0 + gain) for name, gain in gains.items()}
    watched = {name: {"limit": float(at)} for at, name in enumerate(gains)}
    watched |= {"drive_gain": {}, "interference:1": {"omega": 7.0}, "base_vibration:1": {"omega": 7.0}}
    assert worth_refining(models, base, {}, watched) == ["drive_saturation:2", "interference:1"]
    assert worth_refining(models, base, {"electrostatic_drive": 107.0}, watched) == ["drive_saturation:2"]
    assert worth_refining(models, base, {"electrostatic_drive": 200.0}, watched) == []
    # Whoever has the parameter of one that is improved follows it, if it comes as near.
    refined = ["drive_saturation:2", "interference:1"]
    assert worth_following(models, base, {}, watched, refined) == {"base_vibration:1": "interference:1"}
    assert worth_following(models, base, {"electrostatic_drive": 105.0}, watched, refined) == {}
    assert worth_following(models, base, {}, watched, []) == {}


@pytest.mark.parametrize(("likeness", "tried"), [(0.975, True), (0.965, False)])
def test_what_looks_like_the_best_is_carried_beside_it_however_little_it_explains(likeness, tried) -> None:
    view = look(item("kind0", 1000.0), item("kind1", 400.0), item("kind2", 30.0))
    view.seen.normal[0, 0, 2] = view.seen.normal[0, 2, 0] = likeness
    assert ("kind2" in shortlist(view.seen, list(view.evidence.values()))) is tried


def test_by_chance_less_scatter_than_noise_makes_is_no_merit() -> None:
    """One whose parts agree better than they can is not steadier than one whose parts agree as they should."""
    view = look(item("kind0", 1000.0), item("kind1", 400.0), item("kind2", 30.0, scatter=0.05))
    assert shortlist(view.seen, list(view.evidence.values())) == ["kind0", "kind1"]


def test_the_two_steadiest_follow_the_best_at_once_and_five_are_carried() -> None:
    rough = [item(f"kind{n}", 1000.0 - n, scatter=50.0) for n in range(6)]
    view = look(*rough, item("steady", 600.0), item("calm", 550.0), item("little", 100.0))
    assert shortlist(view.seen, view.serious) == ["kind0", "steady", "calm", "kind1", "kind2"]


def test_what_has_half_of_the_best_gain_or_a_likeness_at_the_bound_is_no_leader(monkeypatch) -> None:
    """More than that it takes."""
    items = [item("kind0", 1000.0), item("kind1", 900.0), item("half", 500.0), item("like", 100.0), item("near", 90.0)]
    view = look(*items, item("more", np.nextafter(500.0, 501.0)))
    alike = dict.fromkeys(view.evidence, 0.0) | {"like": 0.97, "near": np.nextafter(0.97, 1.0)}
    monkeypatch.setattr(width, "likeness", lambda seen, name: alike)
    assert shortlist(view.seen, list(view.evidence.values())) == ["kind0", "kind1", "near", "more"]


@pytest.mark.moderate
def test_what_is_left_is_held_against_the_best_of_those_tried() -> None:
    """A hundredth of its gain, and no more."""
    view = crowd(10_000.0)
    leaders = shortlist(view.seen, view.serious)
    tried = dict.fromkeys(leaders, 100.0) | {KINDS[0]: 10_000.0}
    assert asked(view, tried, left=100.0) == []
    assert asked(view, tried, left=np.nextafter(100.0, 101.0)) != []


def test_nine_tenths_of_the_best_gain_are_not_near_enough() -> None:
    base = SimpleNamespace(likelihood=0.0)
    watched = {"interference:1": {"omega": 7.0}, "drive_gain": {}}
    for gain, refined in ((90.0, []), (np.nextafter(90.0, 91.0), ["interference:1"])):
        models = {"drive_gain": SimpleNamespace(likelihood=100.0), "interference:1": SimpleNamespace(likelihood=gain)}
        assert worth_refining(models, base, {}, watched) == refined
