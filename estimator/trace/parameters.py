"""A frequency, a corner or a threshold that an effect has and no filter estimates: moved to where the likelihood is
largest, and how surely it is there.

Each parameter climbs by itself; several are then moved together, since a resonance's frequency, damping and size hang
together.  Close to its top twice the log-likelihood is L − Δᵀ C⁻¹ Δ, with C the covariance of the parameters.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from estimator.effects.catalogue import effect_for
from estimator.scaling import Array
from estimator.settings import ObserverSettings
from estimator.side_by_side import side_by_side
from estimator.thresholds import THRESHOLDS
from estimator.trace.fitting import Fitted, coefficients_of, fit, parameters_of, widening
from estimator.trace.nested import turned_into
from estimator.trace.problem import Problem
from estimator.trace.same_number import agree, in_step, same_numbers
from estimator.trace.searched import NOTHING, Searched

_SET = THRESHOLDS.parameters


def refine_parameters(
    problem: Problem,
    model: Fitted,
    name: str,
    *,
    before: Searched | None = None,
    to_beat: float = -np.inf,
) -> tuple[Fitted, Searched]:
    """`model`, fitted to the record of `problem`, with the parameters of its effect `name` improved, and how surely
    they are known.

    before: how surely they were found earlier, with less of the record or fewer effects; to_beat: twice the
    log-likelihood that another model has: one that comes nowhere near it is left as it is, and so is one that the
    search only made worse.
    """
    _, effect = effect_for(name, problem.device.axes, problem.device.own)
    given = model.settings.effects[name]
    names = tuple(p.name for p in effect.parameters if p.name in given and p.found_as is None)
    if not names:
        return _one_number(problem, model, name, before, to_beat)
    beginning = _beginning(problem, given)
    if before is None and beginning is not None:
        found, searched = _refined_in_two(problem, beginning, model, name, names, to_beat)
    else:
        found, searched = _refined(problem, model, name, names, before, to_beat)
    # Where much is left, a pass from a wide spread may come nowhere near what the passes before the search came to.
    worse = found.likelihood < model.likelihood - _SET.rough_start
    if worse and turned_into(problem, name, parameters_of(found, name)) is None:
        return model, _unknown(name, names, problem)
    return found, searched


def refine_in_turn(
    problem: Problem, model: Fitted, searched: Mapping[str, Searched], names: Iterable[str]
) -> tuple[Fitted, dict[str, Searched]]:
    """`model` with the parameters of these effects improved, one effect after another, each from where it was found:
    what they should be depends on the record and on what else is carried.
    """
    found = dict(searched)
    for name in names:
        if np.isfinite(model.likelihood):
            model, found[name] = refine_parameters(problem, model, name, before=found[name])
    return model, found


def refine_apart(problem: Problem, model: Fitted, name: str) -> tuple[Fitted, Searched]:
    """`model` with those parameters of an effect that are one number with a coefficient moved to the top by themselves.

    A coefficient may stand for something else besides, which is still missing: of a high-pass beside a path that is
    late, both turn the phase, and what blocks constants tells the corner.  As long as the two do not agree, the
    parameter is no account of the coefficient, and counts as not searched for.  A corner slower than the record is a
    drift, which anything may be.
    """
    _, effect = effect_for(name, problem.device.axes, problem.device.own)
    names = tuple(same_numbers(effect))
    if not names or not np.isfinite(model.likelihood):
        return model, NOTHING
    found, searched = _refined(problem, model, name, names, None, -np.inf)
    given = found.settings.effects[name]
    if not found.likelihood > model.likelihood or any(given[which] * problem.span < 1.0 for which in names):
        return model, NOTHING
    return found, searched if agree(problem, found, name, searched) else NOTHING


def _one_number(
    problem: Problem, model: Fitted, name: str, before: Searched | None, to_beat: float
) -> tuple[Fitted, Searched]:
    """`refine_parameters` of an effect whose parameters, if it has any, are its coefficients: searched for where these
    do not tell them.
    """
    _, effect = effect_for(name, problem.device.axes, problem.device.own)
    stepped, settled = in_step(problem, model, name)
    if settled:
        return stepped, NOTHING
    found, searched = max(stepped, model, key=lambda fitted: fitted.likelihood), before
    for _ in range(_SET.sweeps):  # each parameter climbs with the others where they are: not yet right in the first
        begun = found.settings.effects[name]
        found, searched = _refined(problem, found, name, tuple(same_numbers(effect)), searched, to_beat)
        if found.likelihood > stepped.likelihood and agree(problem, found, name, searched):
            return found, searched
        if searched.at_top or _stand(found.settings.effects[name], begun, searched):  # another would come to the same
            break
    return stepped, NOTHING


def _stand(parameters: Mapping[str, float], begun: Mapping[str, float], searched: Searched) -> bool:
    """Whether a search left all of its parameters where it began, as near as a top is asked for."""
    return all(
        abs(parameters[which] - begun[which]) <= _SET.near * searched.deviation(which) for which in searched.names
    )


def _beginning(problem: Problem, given: Mapping[str, float]) -> Problem | None:
    """The part of a long record on which a search begins, if a frequency that is searched for shows on it."""
    samples = max(_SET.beginning, round(_SET.beginning_share * len(problem.record)))
    if samples > _SET.worth_beginning * len(problem.record):
        return None
    part = problem.part(slice(0, samples))
    turns = given.get("omega", np.inf) * part.span / (2.0 * np.pi)
    return part if turns > THRESHOLDS.candidates.periods else None


def _refined_in_two(
    problem: Problem, beginning: Problem, model: Fitted, name: str, names: tuple[str, ...], to_beat: float
) -> tuple[Fitted, Searched]:
    """`refine_parameters` over the beginning of the record, and from there over all of it, which few steps do then."""
    share = len(beginning.record) / len(problem.record)
    begun = fit(beginning.under(model.settings), passes=1)
    # The phase of a frequency that is off grows with the time, and what that costs with its cube.
    power = 3 if "omega" in names else 1
    behind = begun.likelihood + share**power * (to_beat - model.likelihood)
    found, searched = _refined(beginning, begun, name, names, None, behind, moves=False)
    moved = fit(problem.under(found.settings), passes=1, about=found.observer)
    if not moved.likelihood > model.likelihood:
        moved, searched = model, NOTHING
    promised = begun.likelihood + _SET.hope * (found.likelihood - begun.likelihood) + _SET.rough_start
    turned = turned_into(problem, name, {which: moved.settings.effects[name][which] for which in names})
    if promised < behind or turned is not None:
        return moved, _unknown(name, names, problem)
    known = replace(searched, covariance=share * searched.covariance) if searched.names else None
    return _refined(problem, moved, name, names, known, to_beat)


def _unknown(name: str, names: tuple[str, ...], problem: Problem) -> Searched:
    """Of parameters of which nothing is known."""
    _, effect = effect_for(name, problem.device.axes, problem.device.own)
    return Searched(names, np.zeros((len(names), len(names))), np.zeros((len(effect.coefficients), len(names))))


def _refined(
    problem: Problem,
    model: Fitted,
    name: str,
    names: tuple[str, ...],
    before: Searched | None,
    to_beat: float,
    *,
    moves: bool = True,
) -> tuple[Fitted, Searched]:
    """The parameters `names` moved to the top; without `moves`, what they move the coefficients by is not asked, for
    it costs two models a parameter, and is left zero.
    """
    _, effect = effect_for(name, problem.device.axes, problem.device.own)
    given = model.settings.effects[name]
    hill = Hill(problem, model, name, names)
    start = np.array([given[which] for which in names])
    alone = names == ("omega",)
    width = np.full(1, _SET.first_turn / problem.span) if alone else _SET.first_share * start
    if {"omega", "zeta"} <= set(names):  # a mode is as wide as its damping makes it
        width[names.index("omega")] = min(_SET.first_share, given["zeta"]) * given["omega"]
    if before is not None and before.names:
        known = np.sqrt(np.diagonal(before.covariance))
        width = np.where(known > 0.0, np.minimum(width, _SET.fine * known), width)
    top, deviation = start, np.zeros(len(names))
    nothing = np.zeros((len(effect.coefficients), len(names)))

    def hopeless(promised: float = 0.0) -> bool:
        reached = hill.highest + promised - hill.at(start)
        return model.likelihood + _SET.hope * reached + _SET.rough_start < to_beat

    for i in range(len(names)):
        top, deviation[i] = hill.climb(top, i, float(width[i]), hopeless)
        if hopeless() or hill.turned(top):
            return hill.fitted(top), Searched(names, np.diag(deviation**2) / hill.variance, nothing)
    covariance, at_top = np.diag(deviation**2), False
    if len(names) > 1 and np.all(deviation > 0.0):
        top, covariance, at_top = hill.together(top, deviation)
    moved = hill.moves(top, deviation) if moves else nothing
    return hill.fitted(top), Searched(names, covariance / hill.variance, moved, at_top)


def between(one: ObserverSettings, other: ObserverSettings, share: float) -> ObserverSettings:
    """Settings whose initial values and effects' coefficients lie that share of the way from one's to the other's,
    beyond them where it is below 0 or above 1.
    """

    def moved(values: Mapping[str, float], others: Mapping[str, float]) -> dict[str, float]:
        return {name: value + share * (others.get(name, value) - value) for name, value in values.items()}

    return replace(
        one,
        initial=moved(one.initial, other.initial),
        effects={name: moved(given, other.effects[name]) for name, given in one.effects.items()},
    )


class Hill:
    """The likelihood of a model over the parameters of one of its effects.

    Where its innovations are larger than its observer takes them to be, differences of the likelihood are so many times
    the variance too large: what a difference says is counted in `variance`, that of the best so far, 1 at least.
    """

    variance = 1.0

    def __init__(
        self,
        problem: Problem,
        model: Fitted,
        name: str,
        names: tuple[str, ...],
    ) -> None:
        self.problem = problem.under(model.settings)
        self.name, self.names = name, names
        self.model = model
        self.seen: dict[bytes, tuple[float, Array]] = {}
        self.passed: list[tuple[Array, ObserverSettings]] = []
        self.highest, self.best = -np.inf, b""
        self._counts(model)

    def at(self, place: Array) -> float:
        """Twice the log-likelihood with these parameters: of one pass, for that of a second has less of its start in
        it, and only like can be compared with like.  What follows starts from the best so far.
        """
        return self.at_each([place])[0]

    def at_each(self, places: Sequence[Array]) -> list[float]:
        """The same at several, side by side: all start from the best before."""
        new = {key: place for place in places if (key := place.tobytes()) not in self.seen}
        for key, tried in zip(new, side_by_side([partial(self._fit, place) for place in new.values()]), strict=True):
            self.seen[key] = tried.likelihood, self._coefficients(tried)
            if np.isfinite(tried.likelihood):
                self.passed.append((new[key], tried.settings))
            if tried.likelihood > self.highest:
                self.highest, self.model, self.best = tried.likelihood, tried, key
                self._counts(tried)
        return [self.seen[place.tobytes()][0] for place in places]

    def _counts(self, best: Fitted) -> None:
        self.variance = widening(best) ** 2 if np.isfinite(best.likelihood) else 1.0

    def fitted(self, place: Array) -> Fitted:
        """The model with these parameters, as candidates are compared: by a pass about the best so far, which is the
        second; of one pass only where it is a simpler effect, whose own model is compared.
        """
        if not self.turned(place):
            if not np.isfinite(self.model.likelihood):
                return fit(self._at(place))
            return fit(self._at(place), passes=1, about=self.model.observer)
        return self.model if self.best == place.tobytes() else self._fit(place)

    def _fit(self, place: Array) -> Fitted:
        return fit(self._at(place), passes=1)

    def _at(self, place: Array) -> Problem:
        begun = self._beginning(place)
        effects = {effect: dict(given) for effect, given in begun.effects.items()}
        effects[self.name].update(zip(self.names, place.tolist(), strict=True))
        return self.problem.under(begun).carrying(effects)

    def _beginning(self, place: Array) -> ObserverSettings:
        """What a pass begins with: what the best so far found, moved on as between it and the nearest on one line, no
        further beyond them than a step uphill goes, for there what two close ones differ in is noise.

        One that begins far from what it comes to has that in its likelihood, and a climb would creep.
        """
        best = self.model.settings
        if not self.best:
            return best
        here = np.frombuffer(self.best)
        index = np.flatnonzero(place != here)
        others = [one for one in self.passed if np.array_equal(np.flatnonzero(one[0] != here), index)]
        if len(index) != 1 or not others:
            return best
        seen, other = min(others, key=lambda one: float(abs(one[0] - place)[index[0]]))
        along = int(index[0])
        share = float((place - here)[along] / (seen - here)[along])
        return between(best, other, float(np.clip(share, -_SET.growth, _SET.growth)))

    def climb(
        self, place: Array, index: int, width: float, hopeless: Callable[[float], bool] = lambda promised: False
    ) -> tuple[Array, float]:
        """Along one parameter: steps uphill, twice as long each, until both sides are lower; then to the top of the
        parabola through the three, with steps of a few standard deviations.  Returns where, and its deviation, the
        `variance` counted in.

        It ends where the effect has turned into a simpler one, and short of the top where that is `hopeless` or the
        likelihood jumps: of half the step a parabola bends a quarter, a cusp half as much.  A cliff on one side, as
        where a level that cuts the tops lies above them, is left behind by shorter steps.
        """
        deviation, uphill, moves, bent, jumps = 0.0, 0.0, 0, np.inf, 0
        along = np.eye(len(place))[index]
        for _ in range(_SET.rounds):
            if self.turned(place):
                break
            if uphill and (step := self._rises(place, uphill, width, index, moves)):  # what is behind is lower
                place = place + step * along
                width, moves = abs(step) * _SET.growth, moves + 1
                continue
            uphill = 0.0
            width = min(width, _SET.widest * float(place[index]))
            low, here, high = self.at_each([place + side * width * along for side in (-1.0, 0.0, 1.0)])
            if not np.isfinite(low) or not np.isfinite(high):
                width *= _SET.retreat
                continue
            curvature = 2.0 * here - low - high
            bends = curvature >= _SET.seen * self.variance
            shift = 0.5 * width * (high - low) / curvature if bends else np.inf
            wide = width * float(np.sqrt(2.0 * self.variance / curvature)) if bends else 0.0
            narrow = width < 2.0 * _SET.fine * wide
            rises = max(low, high) > here + _SET.seen * self.variance
            if rises and not (narrow and abs(shift) <= _SET.growth * width):  # no parabola whose top is close
                uphill, moves, bent = 1.0 if high > low else -1.0, 1, np.inf
                place = place + uphill * width * along
                width *= _SET.growth
                continue
            if not bends:
                if width >= _SET.widest * place[index]:
                    break
                width *= _SET.flat_growth
                bent = np.inf
                continue
            if curvature > _SET.jump * bent:
                jumps += 1
                if jumps > _SET.jumps or here - max(low, high) > _SET.both_sides * (here - min(low, high)):
                    break
                width *= _SET.approach
                continue
            deviation = wide
            variance = self.variance
            promised = variance * (shift / deviation) ** 2
            if hopeless(promised) or (abs(shift) < _SET.near * deviation and narrow):
                break
            gained = self.at(place + shift * along) - here
            if gained > 0.0:
                place = place + shift * along
            if narrow and abs(gained - promised) < variance * _SET.near**2:  # the parabola holds as far as its top
                break
            # Where the top is as high as the parabola promised, it is one; elsewhere it is come nearer to first.
            fits = narrow or gained > _SET.kept * promised
            bent = curvature
            width = min(_SET.fine * deviation, 0.5 * width) if fits else _SET.approach * width
        return place, deviation

    def turned(self, place: Array) -> bool:
        """Whether the effect is a simpler one there."""
        return turned_into(self.problem, self.name, dict(zip(self.names, place.tolist(), strict=True))) is not None

    def _rises(self, place: Array, side: float, width: float, index: int, moves: int) -> float:
        """The next step uphill along a parameter, 0 where it is none any more; the one after it is tried beside it.

        Each halves what is left of the parameter as often as there were moves: a threshold that goes to nothing is soon
        there.
        """
        along = np.eye(len(place))[index]

        def step(here: Array, longest: float, number: int) -> float:
            return side * min(longest, (1.0 - (1.0 - _SET.widest) ** number) * float(here[index]))

        first = step(place, width, moves)
        places = [place, place + first * along]
        if places[1].tobytes() not in self.seen:
            places.append(places[1] + step(places[1], _SET.growth * abs(first), moves + 1) * along)
        here, there, *_ = self.at_each(places)
        return first if np.isfinite(there) and there > here + _SET.seen * self.variance else 0.0

    def together(self, place: Array, deviation: Array) -> tuple[Array, Array, bool]:
        """All parameters at once, by Newton's method with differences over their deviations; place, covariance, the
        `variance` counted in, and whether that is the top.
        """
        n = len(place)
        steps = np.diag(deviation)
        covariance, at_top = steps**2, False
        for _ in range(_SET.together):
            pairs = [(i, j) for i in range(n) for j in range(i)]
            both = [steps[i] + steps[j] for i, j in pairs]
            found = np.array(self.at_each([place, *(place + step for step in (*steps, *-steps, *both))]))
            here, up, down = found[0], found[1 : n + 1], found[n + 1 : 2 * n + 1]
            slope = (up - down) / 2.0
            bend = np.diag(up + down - 2.0 * here)
            for (i, j), high in zip(pairs, found[2 * n + 1 :], strict=True):
                bend[i, j] = bend[j, i] = high - up[i] - up[j] + here
            sizes, axes = np.linalg.eigh(-bend / 2.0)
            if not np.all(np.isfinite(sizes)) or sizes[0] <= 0.0:
                break
            inverse = (axes / sizes) @ axes.T
            covariance = self.variance * steps @ inverse @ steps
            shift = steps @ (inverse @ slope) / 2.0
            while not np.all(place + shift > 0.0):
                shift = shift / 2.0
            gained = self.at(place + shift) - here
            if gained <= _SET.seen * self.variance:
                at_top = bool(gained >= -_SET.seen * self.variance)
                break
            place = place + shift
        return place, covariance, at_top

    def moves(self, place: Array, deviation: Array) -> Array:
        """By how much one unit of each of the n parameters moves each of the k coefficients (k, n)."""
        sides = [self._beside(place, i, deviation[i]) for i in range(len(place))]
        self.at_each([side for pair in sides for side in pair])
        moved = np.zeros((len(self.seen[sides[0][0].tobytes()][1]), len(place)))
        for i, (low, high) in enumerate(sides):
            if deviation[i] > 0.0:
                difference = self.seen[high.tobytes()][1] - self.seen[low.tobytes()][1]
                moved[:, i] = difference / (high[i] - low[i])
        return moved

    def _beside(self, place: Array, index: int, deviation: float) -> tuple[Array, Array]:
        """A place on either side along a parameter, a deviation away, or what was tried as near as a few."""
        others = np.arange(len(place)) != index
        known = [one for one, _ in self.passed if np.array_equal(one[others], place[others])]
        sides = []
        for side in (-1.0, 1.0):
            away = [(side * (one[index] - place[index]), one) for one in known]
            near = [pair for pair in away if 0.0 < pair[0] <= _SET.fine * deviation]
            step = side * deviation * np.eye(len(place))[index]
            sides.append(max(near, key=lambda pair: float(pair[0]))[1] if near else place + step)
        return sides[0], sides[1]

    def _coefficients(self, model: Fitted) -> Array:
        _, effect = effect_for(self.name, self.problem.device.axes, self.problem.device.own)
        found = coefficients_of(model.observer)[self.name]
        return np.array([found[c.name.partition(":")[0]] for c in effect.coefficients])
