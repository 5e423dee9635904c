"""The form of a missing force: few terms of the library, chosen by what the record says of them.

The innovations of a filter without the force are linear in its coefficients and in what the constants of the base model
are off by.  Their sums of products are computed once for all terms; every set of terms is then compared by Schwarz's
criterion with a price for the number of candidates (Chen & Chen, Biometrika 95(3), 2008).  What all but white noise the
force leaves is taken by a white force in the filter, its size by likelihood, anew with each set.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import sympy as sp
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from estimator.correlation import effective_samples
from estimator.missing_force import library as terms_of
from estimator.missing_force.following import Followed, follow, signatures
from estimator.missing_force.library import Extent, Term, library
from estimator.missing_force.linear import Linear
from estimator.missing_force.points import Points
from estimator.scaling import Array

_MOST = 4  # terms
_ROUNDS = 5
_VISIBLE = 1e-4  # of a column that must stand beside the constants
_SHOWN = 1e-6  # of a term's largest column, below which another one is nothing
_WORTH = 0.02  # of all that is explained, what each term must add, …
_MUCH = 0.3  # … or of what is left without it
_WIDE = (0.1, 0.18, 0.3, 0.45, 0.6, 0.75, 0.87, 1.0, 1.15, 1.35, 1.7, 2.3, 3.5)  # × a number inside a term
_NARROW = (0.8, 0.9, 1.0, 1.1, 1.25)  # × the same, once it was searched
_RAIL = (0.99, 0.995, 1.0, 1.005, 1.01)  # × a rail
_RESOLVED = (-1.0, -0.5, -0.25, 0.0, 0.25, 0.5, 1.0)  # + so many half cycles over the record, of a frequency
_RESOLVED_NEARER = (-0.1, 0.0, 0.1)
_TURNS = 3
_NEAR = 0.01  # of a number inside, that is no other one
_CLOSE = 2e-3  # of the bracket
_MOST_TRIED = 16
_NOISES = 10.0  # by what the white force is changed
_BLOCKS = 40
_COMPARED = 10_000  # samples by which the white force is chosen
_AWAY = 0.06  # of the resonance, of its multiples, where a line is part of the vibration
_PADDED = 8


@dataclass(frozen=True, eq=False)
class Law:
    """Terms with their coefficients, and what the constants of the base model are with them, all scaled.

    terms; coefficients: of each term's columns; covariance (numbers, numbers) of all coefficients, one after another;
    constants: changes by name, offsets (axes,) too; gain: of twice the log-likelihood on the rows that were used,
    counted in independent samples; force_noise: density of the white force that is left beside it.
    """

    terms: tuple[Term, ...]
    coefficients: tuple[Array, ...]
    covariance: Array
    constants: dict[str, float]
    offset: Array
    gain: float
    force_noise: float

    def pushed(self, points: Points) -> tuple[Array, Array]:
        """What the law adds to the state over each interval (n, states), and to what is sensed (n, axes)."""
        n, axes, size = len(points.linear.sense), points.linear.axes, points.linear.states
        pushed, sensed = np.zeros((n, size)), np.zeros((n, axes))
        for term, values in zip(self.terms, self.coefficients, strict=True):
            one, two = points.evaluated(term)
            pushed += one @ values
            sensed += two @ values
        return pushed, sensed


def base_terms(axes: int) -> dict[str, Term]:
    """What the constants of the base model do, by their names; offsets last."""
    x, y, vx, vy, ux = terms_of.x, terms_of.y, terms_of.vx, terms_of.vy, terms_of.ux
    zero = sp.Integer(0)
    pairs = {"kxx": (-x, zero), "dxx": (-vx, zero)}
    if axes == 2:
        pairs |= {"kyy": (zero, -y), "kxy": (-y, -x), "dyy": (zero, -vy), "dxy": (-vy, -vx)}
    else:
        pairs["drive_gain_x"] = (ux, zero)
    found = {name: Term(name, name, (pair,), 0, 0, ("both",)) for name, pair in pairs.items()}
    one = sp.Integer(1)
    found["phi_x"] = Term("phi_x", "phi_x", ((one, zero),), 0, 0, ("x",), sense=True)
    if axes == 2:
        found["phi_y"] = Term("phi_y", "phi_y", ((zero, one),), 0, 0, ("y",), sense=True)
    return found


@dataclass(frozen=True, eq=False)
class _Sums:
    """Products of columns and innovations over their deviations, without the constants of the base model.

    where: columns of each term; normal (c, c), cross (c,), power; samples: independent ones, of so many that
    were counted.
    """

    terms: tuple[Term, ...]
    where: tuple[slice, ...]
    normal: Array
    cross: Array
    power: float
    seen: tuple[bool, ...]
    samples: float
    counted: int

    def left(self, chosen: Sequence[int]) -> float:
        """Power that a set of terms leaves; all of it where a coefficient has a sign that its term cannot have."""
        if not chosen:
            return self.power
        index = np.concatenate([np.arange(self.where[i].start, self.where[i].stop) for i in chosen])
        matrix, right = self.normal[np.ix_(index, index)], self.cross[index]
        size = np.sqrt(np.maximum(np.diagonal(matrix), np.finfo(float).tiny))
        scaled = matrix / np.outer(size, size) + 1e-9 * np.eye(len(size))
        found = np.linalg.solve(scaled, right / size)
        if any(self.terms[i].sign and not self._signed(i, index, found) for i in chosen):
            return self.power
        return max(self.power - float((right / size) @ found), 1e-9 * self.power)

    def _signed(self, term: int, index: NDArray[np.intp], found: Array) -> bool:
        """Whether the coefficient that weighs most has the sign that it must have; the others may be nothing."""
        own = found[(index >= self.where[term].start) & (index < self.where[term].stop)]
        return bool(own[np.argmax(np.abs(own))] * self.terms[term].sign >= 0.0)

    def numbers(self, chosen: Sequence[int]) -> int:
        return sum(self.where[i].stop - self.where[i].start for i in chosen)

    def standing(self, chosen: Sequence[int]) -> float:
        """Twice the log-likelihood less the price."""
        count = self.numbers(chosen) + sum(self.terms[i].threshold is not None for i in chosen)
        # Where samples are not independent the likelihood of a path counts for less, and so does what it costs.
        path = sum(self.terms[i].price for i in chosen) * math.log(self.counted) * self.samples / self.counted
        families = len({term.family for term in self.terms})
        price = count * math.log(self.samples) + path + 2.0 * len(chosen) * math.log(families)
        return -self.samples * math.log(self.left(chosen) / self.power) - price


@dataclass(frozen=True, eq=False)
class _Asked:
    """Columns (rows, columns) of base and terms over the deviations, and the innovations (rows,)."""

    base: Array
    columns: Array
    where: tuple[slice, ...]
    innovation: Array


@dataclass(frozen=True, eq=False)
class _Columns:
    """What base and terms add to the state (n, states, columns) and to what is sensed (n, axes, columns)."""

    count: int
    where: tuple[slice, ...]
    pushed: Array
    sensed: Array


def _columns(points: Points, base: Sequence[Term], terms: Sequence[Term]) -> _Columns:
    edges = np.cumsum([0, *(len(term.columns) for term in (*base, *terms))]).tolist()
    n, axes, size = len(points.linear.sense), points.linear.axes, points.linear.states
    pushed, sensed = np.zeros((n, size, edges[-1])), np.zeros((n, axes, edges[-1]))
    for term, first, last in zip((*base, *terms), edges[:-1], edges[1:], strict=True):
        pushed[:, :, first:last], sensed[:, :, first:last] = points.evaluated(term)
    count = edges[len(base)]
    where = tuple(
        slice(a - count, b - count) for a, b in zip(edges[len(base) : -1], edges[len(base) + 1 :], strict=True)
    )
    return _Columns(count, where, pushed, sensed)


def _asked(points: Points, followed: Followed, columns: _Columns, rows: slice) -> _Asked:
    shown = signatures(points.linear, points.motion, followed, columns.pushed, columns.sensed)
    there = np.all(np.isfinite(points.linear.sense), axis=1)
    there[: rows.start] = False
    there[rows.stop :] = False
    weight = 1.0 / followed.deviation
    flat = (shown * weight[:, :, None])[there].reshape(-1, shown.shape[2])
    innovation = (followed.innovation * weight)[there].ravel()
    return _Asked(flat[:, : columns.count], flat[:, columns.count :], columns.where, innovation)


def _sums(asked: _Asked, terms: tuple[Term, ...]) -> _Sums:
    base = asked.base / np.maximum(np.linalg.norm(asked.base, axis=0), np.finfo(float).tiny)
    u, sizes, _ = np.linalg.svd(base, full_matrices=False)
    basis = u[:, sizes > 1e-9 * sizes[0]]
    innovation = asked.innovation - basis @ (basis.T @ asked.innovation)
    own = np.linalg.norm(asked.columns, axis=0)
    rest = asked.columns - basis @ (basis.T @ asked.columns)
    shown = np.linalg.norm(rest, axis=0) > _VISIBLE * own
    seen = tuple(bool(np.all(shown[part])) and bool(np.all(own[part] > 0.0)) for part in asked.where)
    normal = rest.T @ rest
    cross = rest.T @ innovation
    samples = _independent(innovation)
    return _Sums(terms, asked.where, normal, cross, float(innovation @ innovation), seen, samples, len(innovation))


def _independent(innovation: Array) -> float:
    return max(float(effective_samples(innovation)), 50.0)


def _best(sums: _Sums, most: int) -> list[int]:
    """The set of at most so many terms with the best standing in which every term is worth it."""
    usable = [i for i, seen in enumerate(sums.seen) if seen]
    singles = sorted(usable, key=lambda i: -sums.standing([i]))
    if not singles or sums.standing([singles[0]]) <= 0.0:
        return []
    best: dict[int, list[int]] = {1: [singles[0]]}
    pairs = [list(pair) for pair in combinations(singles, 2) if _compatible(sums, pair)]
    if pairs and most > 1:
        best[2] = max(pairs, key=sums.standing)
    for size in range(3, most + 1):
        if size - 1 not in best:
            break
        grown = [[*best[size - 1], i] for i in singles if _compatible(sums, (*best[size - 1], i))]
        if not grown:
            break
        current = max(grown, key=sums.standing)
        best[size] = _exchanged(sums, current, singles)
    reached = best[1]
    for size in range(2, most + 1):
        if size not in best:
            break
        more = best[size]
        gained = sums.left(reached) - sums.left(more)
        explained = sums.power - sums.left(more)
        added = size - len(reached)
        worth = gained > _WORTH * added * explained or gained > (1.0 - (1.0 - _MUCH) ** added) * sums.left(reached)
        if sums.standing(more) > sums.standing(reached) and worth:
            reached = more
    return reached


def _exchanged(sums: _Sums, chosen: list[int], singles: Sequence[int]) -> list[int]:
    """Each term in turn by whichever stands best in its place, until nothing changes."""
    for _ in range(4):
        before = list(chosen)
        for place in range(len(chosen)):
            rest = chosen[:place] + chosen[place + 1 :]
            trials = [[*rest, i] for i in singles if _compatible(sums, (*rest, i))]
            best = max(trials, key=sums.standing)
            if sums.standing(best) > sums.standing(chosen):
                chosen = best
        if sorted(before) == sorted(chosen):
            break
    return chosen


def _compatible(sums: _Sums, chosen: Sequence[int]) -> bool:
    """One of a family: two thresholds are a curve of free form."""
    families = [(sums.terms[i].family, sums.terms[i].sense) for i in chosen]
    return len(set(families)) == len(families)


def extent_of(points: Points, lines: tuple[float, ...] = (), modulations: tuple[float, ...] = ()) -> Extent:
    """How far the record goes."""

    def largest(kind: str) -> float:
        return max(float(np.quantile(np.abs(points.at_samples[f"{kind}{axis}"]), 0.998)) for axis in axes)

    axes = "xy"[: points.linear.axes]
    drive = largest("u")
    return Extent(
        position=largest(""),
        velocity=largest("v"),
        drive=drive,
        lines=lines,
        modulations=modulations,
        warm="temperature" in points.at_samples and bool(np.ptp(points.at_samples["temperature"]) > 0.0),
        driven=drive > 0.0,
        held=points.linear.drive.shape[2] == 1,
        steepest=largest("du"),
        rail=points.readings.rail,
        lost=any(len(gaps) for gaps in points.readings.lost),
        flips=points.readings.flips,
    )


def propose(points: Points, force_noise: float, rate_intensity: float, rows: slice) -> Law:
    """The form of what is missing, chosen on `rows`; a law without terms where none is worth it."""
    linear, motion = points.linear, points.motion
    base = base_terms(linear.axes)
    own = tuple(base.values())
    nothing = np.zeros_like(motion), np.zeros((len(motion), linear.axes))
    law, followed = _constants(points, force_noise, rate_intensity, rows)
    noise = law.force_noise
    lines, modulations = _waves(points, followed, own, rows)
    terms = library(linear.axes, extent_of(points, lines, modulations))
    columns = _columns(points, own, terms)
    chosen: tuple[Term, ...] = ()
    for turn in range(_ROUNDS):
        if turn:
            followed = follow(linear, motion, *nothing, noise, rate_intensity)
        sums = _sums(_asked(points, followed, columns, rows), terms)
        found = tuple(terms[i] for i in _best(sums, min(turn + 1, _MOST)))
        law = _fitted(points, followed, base, found, rows, noise)
        if not found or (turn > 1 and [term.name for term in found] == [term.name for term in chosen]):
            break
        chosen = found
        noise = noise_of(points, law.pushed(points), noise, rate_intensity, rows, law)
    return _refined(points, law, followed, rate_intensity, rows)


def constants_alone(points: Points, force_noise: float, rate_intensity: float, rows: slice) -> Law:
    """No terms: the constants that go with the base model."""
    return _constants(points, force_noise, rate_intensity, rows)[0]


def _constants(points: Points, force_noise: float, rate_intensity: float, rows: slice) -> tuple[Law, Followed]:
    """Without terms, and the filter that goes with it; what constants take up is no white force."""
    nothing = np.zeros_like(points.motion), np.zeros((len(points.motion), points.linear.axes))
    base = base_terms(points.linear.axes)
    noise, changed = force_noise, None
    for _ in range(2):
        noise = noise_of(points, nothing, noise, rate_intensity, rows, changed)
        followed = follow(points.linear, points.motion, *nothing, noise, rate_intensity)
        changed = _fitted(points, followed, base, (), rows, noise)
    assert changed is not None
    return changed, followed


def _refined(points: Points, law: Law, followed: Followed, rate_intensity: float, rows: slice) -> Law:
    """With the numbers inside the terms, one after another, where they leave least in the filter; the white force that
    goes with them anew each time.
    """
    inside = [i for i, term in enumerate(law.terms) if term.threshold is not None]
    base = base_terms(points.linear.axes)
    nothing = np.zeros_like(points.motion), np.zeros((len(points.motion), points.linear.axes))
    for turn in range(_TURNS if inside else 0):
        before = law
        for i in inside:
            own = law.terms[i]
            beside = (*law.terms[:i], *law.terms[i + 1 :])
            left = _Beside(points, followed, (*base.values(), *beside), rows)
            best = _least(left, own, _scan(own, points, rows, wide=turn == 0))
            terms = (*law.terms[:i], best, *law.terms[i + 1 :])
            law = _fitted(points, followed, base, terms, rows, law.force_noise)
        noise = noise_of(points, law.pushed(points), law.force_noise, rate_intensity, rows, law)
        followed = follow(points.linear, points.motion, *nothing, noise, rate_intensity)
        law = _fitted(points, followed, base, law.terms, rows, noise)
        if all(abs(_inside(law.terms[i]) / _inside(before.terms[i]) - 1.0) < _NEAR for i in inside):
            break
    return law


def _inside(term: Term) -> float:
    assert term.threshold is not None
    return term.threshold[1]


def _scan(term: Term, points: Points, rows: slice, *, wide: bool) -> list[float]:
    """Numbers around a term's own and itself, among which the search begins; ascending."""
    at = _inside(term)
    if term.threshold is not None and term.threshold[0] == "w":
        resolved = np.pi / (points.linear.step * (rows.stop - rows.start))
        return [at + resolved * share for share in (_RESOLVED if wide else _RESOLVED_NEARER)]
    if term.series == "reading":
        return [at * factor for factor in _RAIL]
    return [at * factor for factor in (_WIDE if wide else _NARROW)]


class _Beside:
    """Power that a term leaves, with others and the constants beside it."""

    def __init__(self, points: Points, followed: Followed, others: Sequence[Term], rows: slice) -> None:
        self.points, self.followed, self.rows = points, followed, rows
        asked = _asked(points, followed, _columns(points, others, ()), rows)
        base = asked.base / np.maximum(np.linalg.norm(asked.base, axis=0), np.finfo(float).tiny)
        u, sizes, _ = np.linalg.svd(base, full_matrices=False)
        self.basis = u[:, sizes > 1e-9 * sizes[0]]
        self.innovation = asked.innovation - self.basis @ (self.basis.T @ asked.innovation)

    def __call__(self, term: Term) -> float:
        columns = _asked(self.points, self.followed, _columns(self.points, (), (term,)), self.rows).columns
        columns = columns - self.basis @ (self.basis.T @ columns)
        size = np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
        found, *_ = np.linalg.lstsq(columns / size, self.innovation, rcond=1e-9)
        return float(np.sum((self.innovation - columns / size @ found) ** 2))


def _least(left: Callable[[Term], float], term: Term, ends: Sequence[float]) -> Term:
    """Where the least is left: the best of a scan, then between its neighbours (Brent)."""
    powers = [left(term.at(value)) for value in ends]
    best = int(np.argmin(powers))
    low, high = ends[max(best - 1, 0)], ends[min(best + 1, len(ends) - 1)]
    found = minimize_scalar(
        lambda value: left(term.at(value)), bounds=(low, high), method="bounded",
        options={"xatol": _CLOSE * (high - low), "maxiter": _MOST_TRIED},
    )  # fmt: skip
    return term.at(float(found.x)) if found.fun < powers[best] else term.at(ends[best])


def noise_of(
    points: Points,
    known: tuple[Array, Array],
    begin: float,
    rate_intensity: float,
    rows: slice,
    changed: Law | None = None,
) -> float:
    """Density of the white force with the largest likelihood, beside what is known to push and to be sensed."""
    part = slice(max(rows.stop - _COMPARED, rows.start), rows.stop)
    linear = points.linear if changed is None else with_constants(points.linear, changed)
    short, (pushed, sensed) = part_of(linear, part), known

    def worth(density: float) -> float:
        return follow(short, points.motion[part], pushed[part], sensed[part], density, rate_intensity).likelihood

    best, reached = begin, worth(begin)
    for factor in (_NOISES, 1.0 / _NOISES):
        while 1e-18 < best * factor < 1e-1 and (value := worth(best * factor)) > reached:
            best, reached = best * factor, value
    return best


def part_of(linear: Linear, rows: slice) -> Linear:
    """The samples of `rows`."""
    return replace(linear, sense=linear.sense[rows], drive=linear.drive[rows], rate=linear.rate[rows])


def with_constants(linear: Linear, law: Law) -> Linear:
    """With what the constants are beside a law."""
    constants = {name: value + law.constants.get(name, 0.0) for name, value in linear.constants.items()}
    return replace(linear, constants=constants, offset=linear.offset + law.offset)


def _fitted(
    points: Points, followed: Followed, base: dict[str, Term], chosen: tuple[Term, ...], rows: slice, noise: float
) -> Law:
    asked = _asked(points, followed, _columns(points, tuple(base.values()), chosen), rows)
    both = np.concatenate([asked.base, _shown(asked)], axis=1)
    size = np.linalg.norm(both, axis=0)
    size[size == 0.0] = 1.0
    scaled = both / size
    inverse = np.linalg.pinv(scaled.T @ scaled, rcond=1e-13, hermitian=True)
    weights = inverse @ (scaled.T @ asked.innovation)
    left = asked.innovation - scaled @ weights
    # By blocks of the record: what is left is neither white nor of one size (Newey & West, Econometrica 55(3), 1987).
    scores = np.array(
        [a.T @ b for a, b in zip(np.array_split(scaled, _BLOCKS), np.array_split(left, _BLOCKS), strict=True)]
    )
    wide = inverse @ (scores.T @ scores) @ inverse * _BLOCKS / (_BLOCKS - 1)
    plain = inverse * float(left @ left) / max(len(left) - len(size), 1)
    covariance = np.where(np.diagonal(wide) > np.diagonal(plain), 1.0, 0.0)
    covariance = wide if float(np.mean(covariance)) > 0.5 else plain
    values, covariance = weights / size, covariance / np.outer(size, size)
    count = asked.base.shape[1]
    without = asked.innovation
    if count:
        q, _ = np.linalg.qr(scaled[:, :count])
        without = without - q @ (q.T @ without)
    samples = _independent(without)
    gain = -samples * math.log(max(float(left @ left) / float(without @ without), 1e-300))
    changes = dict(zip(base, values[:count].tolist(), strict=True))
    offset = np.array([changes.pop(name) for name in ("phi_x", "phi_y")[: points.linear.axes]])
    own = values[count:]
    return Law(
        chosen, tuple(own[part] for part in asked.where), covariance[count:, count:], changes, offset, gain, noise
    )


def _shown(asked: _Asked) -> Array:
    """Columns of the terms; of an axis on which these rows show nothing of its term there is none, and its coefficient
    is zero.
    """
    norms, columns = np.linalg.norm(asked.columns, axis=0), asked.columns.copy()
    for part in asked.where:
        columns[:, part] *= norms[part] > _SHOWN * np.max(norms[part])
    return columns


def _waves(
    points: Points, followed: Followed, base: Sequence[Term], rows: slice
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Frequencies, scaled, of the line beside the vibration that stands out most, and of the change of stiffness."""
    own = [points.evaluated(base[0])]
    if points.linear.axes == 2:
        own.append(points.evaluated(next(term for term in base if term.name == "kyy")))
    pushed = np.ascontiguousarray(np.concatenate([one for one, _ in own], axis=2))
    sensed = np.ascontiguousarray(np.concatenate([two for _, two in own], axis=2))
    shown = np.sum(signatures(points.linear, points.motion, followed, pushed, sensed), axis=2)[rows]
    normal = np.nan_to_num(followed.innovation[rows] / followed.deviation[rows])
    h = points.linear.step
    resonance = float(np.sqrt(np.mean([points.linear.constants.get(name, 1.0) for name in ("kxx",)])))
    n = len(normal) * _PADDED
    frequency: Array = np.asarray(2.0 * np.pi * np.fft.rfftfreq(n, h), dtype=float)
    window = np.hanning(len(normal))
    spectrum = np.sum(np.abs(np.fft.rfft(normal * window[:, None], n, axis=0)) ** 2, axis=1)
    order = np.maximum(np.round(frequency / resonance), 0.0)
    beside = np.abs(frequency - order * resonance) > _AWAY * resonance
    lines = _peak(frequency, np.where(beside, spectrum, 0.0), 16 * _PADDED)
    product = np.sum(normal * shown / followed.deviation[rows], axis=1)
    changed = np.abs(np.fft.rfft((product - np.mean(product)) * window, n)) ** 2
    low = (frequency > 8.0 * np.pi / (h * len(normal))) & (frequency < 0.9 * resonance)
    return lines, _peak(frequency, np.where(low, changed, 0.0), 16 * _PADDED)


def _peak(frequency: Array, power: Array, beside: int) -> tuple[float, ...]:
    """Where the largest power is, by a parabola; nothing where it does not stand out of what is there."""
    top = int(np.argmax(power))
    there = power[power > 0.0]
    if not 0 < top < len(power) - 1 or not len(there) or power[top] < 30.0 * float(np.median(there)):
        return ()
    a, b, c = np.log(np.maximum(power[top - 1 : top + 2], np.finfo(float).tiny))
    shift = 0.5 * (a - c) / (a - 2.0 * b + c) if a - 2.0 * b + c < 0.0 else 0.0
    return (float(frequency[top] + shift * (frequency[1] - frequency[0])),)
