"""The pass over a record against a plain Kalman filter: likelihood, scores and information by any parameter."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import pytest

from estimator.gaps import Gaps
from estimator.record import Record
from estimator.settings import Device, Gain, ObserverSettings, ProcessNoise, Spread
from estimator.trace.filtered import Filtered
from estimator.trace.likelihood import BLOCKS, Evaluation, Model, Noise
from estimator.trace.problem import Effects, Problem
from tests.trace.plain import (
    ALONE,
    AMPLITUDE,
    BASE,
    GAIN,
    NOISE,
    OMEGA0,
    RATE,
    Array,
    Plain,
    nothing,
    simulated,
)

N = 360
SPREAD = {1: np.array([0.3 * AMPLITUDE, 0.3 * AMPLITUDE * OMEGA0, 0.01]), 2: np.zeros(0)}
SPREAD[2] = np.array([*SPREAD[1][:2], *SPREAD[1][:2], 0.01, 0.01, 0.2])
FACTORS, FORCE, WALK = np.array([1.3, 0.8]), 2e-3, 0.4
WARMTH = 20.0 + np.linspace(0.0, 3.0, N) ** 2
Written = Callable[..., tuple[Array | float, ...]]


@dataclass(frozen=True)
class Case:
    """A record with parameters about which the innovations are looked at."""

    axes: int = 2
    effects: Effects = field(default_factory=dict)
    force: Written = nothing
    sense: Written = nothing
    substeps: int = 0
    uneven: bool = False
    lost: tuple[tuple[int, int], ...] = ()
    gaps: Mapping[int, Array] = field(default_factory=dict)
    jump: int = N
    delay: bool = False

    @property
    def base(self) -> dict[str, float]:
        return BASE if self.axes == 2 else ALONE

    def made(self) -> tuple[Filtered, Plain, tuple[Array, Array, Array]]:
        rng = np.random.default_rng(5)
        step = rng.uniform(0.7, 1.3, N) / RATE if self.uneven else None
        z, u, h, begun = simulated(N, self.base, axes=self.axes, seed=3, step=step)
        for row, axis in self.lost:
            z[row, axis] = np.nan
        z[self.jump : self.jump + 4] += 40 * NOISE[: self.axes]
        last = np.array(sorted(self.gaps), dtype=np.int64)
        gaps = Gaps(last, np.array([self.gaps[k] for k in sorted(self.gaps)])) if len(last) else None
        record = Record(z, u[:, :, None], h, {"temperature": WARMTH}, gaps)
        names = ("x", "vx", "y", "vy")[: 2 * self.axes]
        motion = begun * np.array([1.05, 0.95, 1.02, 1.01])[: 2 * self.axes]
        stiffness = [self.base[name] for name in ("kxx", "kyy", "kxy") if name in self.base]
        damping = [self.base[name] for name in ("dxx", "dyy", "dxy") if name in self.base]
        device = Device(
            RATE, tuple(stiffness), tuple(damping), AMPLITUDE, tuple(GAIN[: self.axes]), tuple(NOISE[: self.axes]),
            target_stiffness=OMEGA0**2, drive_gain=self.base.get("drive_gain_x", 1.0),
        )  # fmt: skip
        settings = ObserverSettings(
            gain=Gain.EKF, initial=dict(zip(names, motion.tolist(), strict=True)),
            spread=Spread(position=0.3, velocity=0.3, offset=0.01, rate=0.2, stiffness=0.01, damping=0.5),
            process_noise=ProcessNoise(force=1e-4, rate=0.1), effects=self.effects,
        )  # fmt: skip
        plain = Plain(
            self.axes, SPREAD[self.axes], motion, NOISE * FACTORS, FORCE, WALK,
            self.force, self.sense, self.substeps, self.gaps,
        )  # fmt: skip
        return Filtered(Problem(record, device, settings)), plain, (z, u, h)


def model_of(of: Filtered, effects: Effects) -> Model:
    layout = of.layout(effects)
    noise = Noise(tuple(FACTORS[: of.axes].tolist()), FORCE, WALK)
    return Model(effects, layout.mean, noise)


def expected(
    case: Case, plain: Plain, series: tuple[Array, Array, Array], about: Mapping[str, float],
    moved: Mapping[str, float],
) -> tuple[Array, Array, Array, Array]:  # fmt: skip
    """Whitened innovations (n, axes), their slopes by the parameters `moved` over so much, logarithms of their
    deviations, and the innovations; rows that do not count are NaN.
    """
    p = {name: np.full(1 + 2 * len(moved), value) for name, value in about.items()}
    for k, (name, size) in enumerate(moved.items()):
        p[name][1 + 2 * k : 3 + 2 * k] += np.array([size, -size])
    z, u, h = series
    e, covariance = plain.follow(z, u, h, p, WARMTH)
    root = np.linalg.cholesky(covariance)
    white = np.linalg.solve(root, np.nan_to_num(e))
    white[~np.isfinite(e[:, :, 0])] = np.nan
    white[: int(np.ceil(3.0 * RATE * 2 * np.pi / OMEGA0))] = np.nan
    slopes = (white[:, :, 1::2] - white[:, :, 2::2]) / (2.0 * np.array(list(moved.values())))
    logs = np.log(np.diagonal(root, axis1=1, axis2=2) / np.abs(GAIN[: case.axes] * AMPLITUDE))
    return white[:, :, 0], slopes, np.where(np.isnan(white[:, :, 0]), np.nan, logs), e[:, :, 0]


def sums(white: Array, slopes: Array) -> tuple[Array, Array]:
    """Score and information by part of the record."""
    edges = np.linspace(0, N, BLOCKS + 1).astype(int)
    parts = [slice(a, b) for a, b in pairwise(edges.tolist())]
    score = [-np.nansum(slopes[rows] * white[rows][:, :, None], axis=(0, 1)) for rows in parts]
    flat = [np.nan_to_num(slopes[rows].reshape(-1, slopes.shape[2])) for rows in parts]
    return np.array(score), np.array([one.T @ one for one in flat])


def agree(found: Array, wanted: Array, share: float) -> None:
    """Within so much of the largest of each column over the parts."""
    size = np.max(np.abs(wanted), axis=0)
    assert np.all(size > 0.0)
    assert np.max(np.abs(found - wanted) / size) < share


def same(of: Evaluation, white: Array, logs: Array, e: Array) -> None:
    """The likelihood and what it is made of."""
    told = np.isfinite(white)
    n = np.sum(told)
    assert of.count.sum() == n
    scale = np.nansum(white**2) / n
    assert of.scale == pytest.approx(scale, rel=1e-6)
    assert of.logs.sum() == pytest.approx(np.nansum(logs), rel=1e-7)
    assert of.log_likelihood == pytest.approx(-n / 2 * (np.log(2 * np.pi * scale) + 1) - np.nansum(logs), abs=1e-3)
    assert np.array_equal(np.isnan(of.innovation), np.isnan(e))
    assert np.nanmax(np.abs(of.innovation - e)[60:]) < 1e-4 * NOISE[0]


UNSURE = (0.02 * AMPLITUDE * np.diag([1.0, OMEGA0, 1.0, OMEGA0])) ** 2
PLACES = {
    "plain": Case(),
    "lost": Case(lost=((100, 0), (101, 0), (140, 1), (200, 0), (200, 1), (201, 0), (201, 1))),
    "large innovations count in full": Case(jump=200),
    "uneven": Case(uneven=True),
    "gaps": Case(lost=((119, 0), (119, 1)), gaps={119: UNSURE, 180: UNSURE / 16, 240: np.full((4, 4), np.inf)}),
    "single": Case(axes=1),
    "single, uneven": Case(axes=1, uneven=True, lost=((90, 0), (91, 0))),
}


@pytest.mark.moderate
@pytest.mark.parametrize("place", PLACES)
def test_likelihood_and_scores_of_the_base_model_are_a_plain_filter_s(place: str) -> None:
    case = PLACES[place]
    of, plain, series = case.made()
    layout = of.layout({})
    assert layout.names == tuple(case.base)
    seen = of.evaluate(layout, model_of(of, {}))
    moved = {name: 1e-5 * factor for name, factor in zip(layout.names, layout.factor, strict=True)}
    about = {name: float(v) for name, v in zip(layout.names, layout.mean * layout.factor, strict=True)}
    assert about == pytest.approx(case.base)
    white, slopes, logs, e = expected(case, plain, series, about, moved)
    same(seen, white, logs, e)
    score, information = sums(white, slopes * layout.factor)
    agree(seen.score, score, 1e-5)
    agree(seen.information, information, 1e-5)


@dataclass(frozen=True)
class Law:
    """An effect as its page has it, in SI: coefficients of about plausible size, its parameters."""

    coefficients: Mapping[str, float]
    force: Written = nothing
    sense: Written = nothing
    given: Mapping[str, float] = field(default_factory=dict)
    share: float = 2e-4

    def included(self, name: str) -> tuple[Effects, Case]:
        """The effect with a twentieth of its coefficients, and a record that has it."""
        effects = {name: {**{key: 0.05 * value for key, value in self.coefficients.items()}, **self.given}}
        return effects, self.case(effects)

    def case(self, effects: Effects) -> Case:
        return Case(effects=effects, force=self.force, sense=self.sense, substeps=0 if self.force is nothing else 16)


def line(p: Mapping[str, Array], t: float, names: str) -> tuple[Array, Array]:
    c, s = np.cos(p["omega"] * t), np.sin(p["omega"] * t)
    return p[f"{names}cx"] * c + p[f"{names}sx"] * s, p[f"{names}cy"] * c + p[f"{names}sy"] * s


A, W, F = AMPLITUDE, OMEGA0, AMPLITUDE * OMEGA0**2
LAWS = {
    "cubic_stiffness": Law(
        {"k3x": 0.03 * W**2 / A**2, "k3y": -0.02 * W**2 / A**2},
        lambda s, u, t, w, p: (-p["k3x"] * s[0] ** 3, -p["k3y"] * s[2] ** 3),
    ),
    "nonlinear_damping": Law(
        {"d3x": 0.008 * W / A**2, "d3y": 0.005 * W / A**2},
        lambda s, u, t, w, p: (-p["d3x"] * s[0] ** 2 * s[1], -p["d3y"] * s[2] ** 2 * s[3]),
    ),
    "dry_friction": Law(
        {"fx": 0.003 * F, "fy": 0.004 * F},
        lambda s, u, t, w, p: (-p["fx"] * np.tanh(s[1] / p["v0"]), -p["fy"] * np.tanh(s[3] / p["v0"])),
        given={"v0": 0.3 * A * W}, share=3e-3,
    ),
    "drive_misalignment": Law(
        {"mx": 0.03, "my": -0.05}, lambda s, u, t, w, p: (p["mx"] * u[1], p["my"] * u[0])
    ),
    "electrostatic_drive": Law(
        {"qx": 1.0 / F, "qy": 2.0 / F}, lambda s, u, t, w, p: (p["qx"] * u[0] ** 2, p["qy"] * u[1] ** 2)
    ),
    "sense_quadratic": Law(
        {"a2x": 0.01 / A, "a2y": 0.02 / A}, sense=lambda s, u, t, w, p: (p["a2x"] * s[0] ** 2, p["a2y"] * s[2] ** 2)
    ),
    "drive_feedthrough": Law(
        {"fdx": 0.03 / W**2, "fdy": -0.02 / W**2}, sense=lambda s, u, t, w, p: (p["fdx"] * u[0], p["fdy"] * u[1])
    ),
    "sense_delay": Law({"tsx": 0.1 / W, "tsy": 0.2 / W}),
    "drive_delay": Law({"tux": 0.1 / W, "tuy": 0.2 / W}),
    "interference": Law(
        {"lcx": 0.01 * A, "lsx": 0.02 * A, "lcy": -0.01 * A, "lsy": 0.005 * A},
        sense=lambda s, u, t, w, p: line(p, t, "l"), given={"omega": 777.0},
    ),
    "base_vibration": Law(
        {"bcx": 0.01 * F, "bsx": 0.02 * F, "bcy": -0.01 * F, "bsy": 0.005 * F},
        lambda s, u, t, w, p: line(p, t, "b"), given={"omega": 777.0},
    ),
    "temperature_stiffness": Law(
        {"ktx": 1e-3 * W**2, "kty": 5e-4 * W**2, "ktxy": 2e-4 * W**2},
        lambda s, u, t, w, p: (-w * (p["ktx"] * s[0] + p["ktxy"] * s[2]), -w * (p["ktxy"] * s[0] + p["kty"] * s[2])),
    ),
}  # fmt: skip


@pytest.mark.moderate
@pytest.mark.parametrize("name", LAWS)
def test_scores_of_an_included_effect_are_those_of_a_plain_filter(name: str) -> None:
    law = LAWS[name]
    effects, case = law.included(name)
    of, plain, series = case.made()
    layout = of.layout(effects)
    places = layout.of(name)
    assert [layout.names[k] for k in places] == [*law.coefficients, *law.given]
    seen = of.evaluate(layout, model_of(of, effects))
    moved = {layout.names[k]: 1e-5 * float(layout.factor[k]) for k in places[: len(law.coefficients)]}
    about = {**BASE, **effects[name]}
    white, slopes, logs, e = expected(case, plain, series, about, moved)
    same(seen, white, logs, e)
    rows = places[: len(moved)]
    score, information = sums(white, slopes * layout.factor[rows])
    agree(seen.score[:, rows], score, law.share)
    agree(seen.information[:, rows][:, :, rows], information, law.share)


@pytest.mark.moderate
@pytest.mark.parametrize("name", LAWS)
def test_scores_of_a_watched_effect_are_those_of_a_plain_filter_without_it(name: str) -> None:
    law = LAWS[name]
    case = law.case({})
    of, plain, series = case.made()
    layout = of.layout({})
    seen = of.evaluate(layout, model_of(of, {}), tested={name: law.given})
    assert seen.names == (*BASE, *[name] * len(law.coefficients))
    factor = of.layout({name: law.given}).factor[len(BASE) : len(BASE) + len(law.coefficients)]
    moved = dict(zip(law.coefficients, (1e-4 * factor).tolist(), strict=True))
    white, slopes, logs, e = expected(case, plain, series, {**BASE, **dict.fromkeys(moved, 0.0), **law.given}, moved)
    same(seen, white, logs, e)
    score, information = sums(white, slopes * factor)
    agree(seen.score[:, len(BASE) :], score, law.share)
    agree(seen.information[:, len(BASE) :, len(BASE) :], information, law.share)


@pytest.mark.moderate
@pytest.mark.parametrize(("name", "searched"), [("interference", "omega"), ("dry_friction", "v0")])
def test_scores_of_a_searched_parameter_equal_whole_differences(name: str, searched: str) -> None:
    """Its gain moves along: two runs of the plain filter, each with its own."""
    law = LAWS[name]
    effects, case = law.included(name)
    of, plain, series = case.made()
    layout = of.layout(effects)
    place = layout.names.index(searched)
    assert layout.mean[place] * layout.factor[place] == pytest.approx(law.given[searched])
    seen = of.evaluate(layout, model_of(of, effects))
    about, size = {**BASE, **effects[name]}, 1e-4 * law.given[searched]
    white, _, _, _ = expected(case, plain, series, about, {"kxx": 1.0})
    sides = [{**about, searched: law.given[searched] + step} for step in (size, -size)]
    ends = [expected(case, plain, series, side, {"kxx": 1.0})[0] for side in sides]
    slopes = ((ends[0] - ends[1]) / (2.0 * size) * layout.factor[place])[:, :, None]
    score, information = sums(white, slopes)
    agree(seen.score[:, [place]], score, 2e-3)
    agree(seen.information[:, [place]][:, :, [place]], information, 2e-3)
