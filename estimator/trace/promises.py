"""What "explained" promises, and the guards that hold a diagnosis to it.

A guard looks at a claim, which is what a trace is about to say and what the part of the record that the choice never
saw makes of it, and tells in a sentence what stands against it.  All families of models stand before the same guards:
two axes, the free run, the rate sensor.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

from estimator.chance import TWO_SIDED, f_isf
from estimator.effects.characteristic import Characteristic, characteristic
from estimator.effects.labels import declared, kind
from estimator.thresholds import THRESHOLDS
from estimator.trace.determined import not_determined
from estimator.trace.engine import Estimate, unphysical
from estimator.trace.nameless import Contest
from estimator.trace.sidebands import Sidebands

_SET = THRESHOLDS.promises


@dataclass(frozen=True)
class Errors:
    """rms of an error before and after, on the part held out, and what a complete model would leave, in one unit.

    samples: independent ones behind the rms; floor_samples: behind the floor; gain: of twice the log-likelihood of
    these samples, coefficients as they are, where it can be told: it sees what the rms of a long record does not.
    """

    before: float
    after: float
    floor: float
    samples: float = math.inf
    floor_samples: float = math.inf
    gain: float | None = None

    @property
    def fell(self) -> bool:
        """Whether it is less than before; what is no number did not fall.

        Coefficients that were found elsewhere and would gain g, were they right, lose g where nothing of the kind is
        there: 0 is the middle.  What gains may leave the rms where it was, and not raise it by more than one of so many
        samples is sure of itself.
        """
        if not math.isfinite(self.after):
            return False
        if self.gain is None:
            return self.after < self.before
        sure = 1.0 / math.sqrt(2.0 * max(self.samples, 1.0))
        return self.gain > 0.0 and self.after <= self.before * (1.0 + sure)

    @property
    def at_floor(self) -> bool:
        """Whether it is no more than `promises.floor` times the floor, or than chance makes of the floor."""
        return self.within(_SET.floor)

    def within(self, times: float) -> bool:
        """Whether it is no more than so many times the floor, or than chance makes of the floor."""
        if not math.isfinite(self.after):
            return False
        few = max(min(self.samples, 1e9), 1.0), max(min(self.floor_samples, 1e9), 1.0)
        return self.after <= self.floor * max(times, math.sqrt(f_isf(_SET.floor_chance, *few)))

    @property
    def nothing_above(self) -> bool:
        """Whether nothing stood above the floor before."""
        return self.before <= self.floor

    @property
    def share(self) -> float:
        """Of the power above the floor, how much went: 1 all, below 0 where it rose; 0 where there was none."""
        was, left = (error**2 - self.floor**2 for error in (self.before, self.after))
        return 1.0 - max(left, 0.0) / was if was > 0.0 and math.isfinite(left) else 0.0


@dataclass(frozen=True)
class Constant:
    """A constant of the model as found, with its 95 % interval, beside the value that is declared and its standard
    deviation; positive: whether physics asks for it.
    """

    name: str
    value: float
    low: float
    high: float
    declared: float
    deviation: float
    positive: bool = False


@dataclass(frozen=True)
class Level:
    """A range that an effect says its channel cannot leave, the extremes of the part held out, and the noise; unit: of
    all of them.
    """

    effect: str
    low: float
    high: float
    lowest: float
    highest: float
    noise: float
    unit: str = "V"


@dataclass(frozen=True)
class Vote:
    """An error against something measured beside the record: what it is in words, and its size before and after.

    moved: rms of what the effects move the estimate by, where the error need not go, only must not grow.
    """

    what: str
    unit: str
    errors: Errors
    moved: float | None = None

    @property
    def against(self) -> bool:
        """Whether it speaks against what is named: it is more than is to be expected, and most of it stays; or, where
        it need not go, it grew by more than chance: with e the error before and δ the move, |e + δ|² − |e|² has, of n
        samples, a standard deviation of 2|e||δ|/√n.
        """
        errors = self.errors
        if errors.at_floor:
            return False
        if self.moved is None:
            return not errors.share >= _SET.part
        by_chance = 2.0 * TWO_SIDED * errors.before * self.moved / math.sqrt(max(errors.samples, 1.0))
        return not errors.after**2 <= errors.before**2 + by_chance


@dataclass(frozen=True)
class Departure:
    """By how much the coefficients of an effect differ from part to part of the record, rms, in their own size, noise
    taken off; chance: the probability that noise makes as much.
    """

    size: float
    chance: float


@dataclass(frozen=True)
class Claim:
    """What is about to be said: the effects with their coefficients by name, and all that may speak against it.

    observed: where the residual is that of a free run, that of an observer that carries the effects.
    """

    residual: Errors
    effects: Mapping[str, Mapping[str, Estimate]]
    constants: tuple[Constant, ...] = ()
    levels: tuple[Level, ...] = ()
    votes: tuple[Vote, ...] = ()
    contest: Contest | None = None
    departures: Mapping[str, Departure] = field(default_factory=dict)
    observed: Errors | None = None
    sidebands: tuple[Sidebands, ...] = ()


def fell(claim: Claim) -> tuple[str, ...]:
    """What is explained is gone: the residual of data that the choice never saw is smaller than before."""
    errors = claim.residual
    if errors.fell:
        return ()
    if errors.gain is not None and errors.gain <= 0.0 and errors.after <= _SET.floor * errors.before:
        return (f"the part held out is not predicted better: {_gain(errors.gain)} in twice the log-likelihood",)
    return (f"on the part held out the residual rose from {_times(errors.before, errors)} to {_over(errors)}",)


def observed(claim: Claim) -> tuple[str, ...]:
    """What mends a free run does not make an observer worse, which is what the bench runs with it."""
    errors = claim.observed
    if errors is None or errors.fell or errors.at_floor:
        return ()
    was, left = _times(errors.before, errors), _over(errors)
    return (f"an observer that carries it leaves more of the part held out: {left}, was {was}",)


def at_floor(claim: Claim) -> tuple[str, ...]:
    """What is explained leaves nothing: that residual is the noise, or of a size that does not matter, or at least less
    than what went.
    """
    errors = claim.residual
    if not errors.at_floor:
        return (f"what is left of the part held out is {_over(errors)}",)
    small = errors.within(math.sqrt(1.0 + THRESHOLDS.judgement.level))
    if claim.effects and not small and errors.share < _SET.part:
        went = max(errors.share, 0.0)
        return (f"of what stood above the noise floor on the part held out {went:.0%} went: {_over(errors)} is left",)
    return ()


def signs(claim: Claim) -> tuple[str, ...]:
    """Friction that drives is no friction, and a gain of the other sign is one only where a polarity makes it so."""
    return tuple(why for name in claim.effects if (why := wrong_sign(name, claim.effects[name])))


def beyond_zero(claim: Claim) -> tuple[str, ...]:
    """What may as well be nothing is not there: some coefficient of each effect is other than zero at 95 %."""
    return tuple(why for name in claim.effects if (why := may_be_nothing(name, claim.effects[name])))


def constants(claim: Claim) -> tuple[str, ...]:
    """A model that only fits with constants that the device cannot have fits something else."""
    return tuple(why for constant in claim.constants if (why := conflict(constant)))


def undetermined(claim: Claim) -> tuple[str, ...]:
    """A sentence on the constants of which the record says less than the bench file: of 1/σ², the information of both,
    the file's own is more than half.
    """

    def unsure(one: Constant) -> bool:
        return (one.high - one.low) / (2.0 * TWO_SIDED) > one.deviation / math.sqrt(2.0)

    left = [one.name for one in claim.constants if one.name != "rate" and unsure(one)]
    return (not_determined(left),) if left else ()


def levels(claim: Claim) -> tuple[str, ...]:
    """What is said to be impossible must not have been seen."""
    return tuple(said for one in claim.levels if (said := contradicted(one)))


def votes(claim: Claim) -> tuple[str, ...]:
    """What mends the residual and not the quantity that the device is there to measure has mended the wrong thing."""
    return tuple(
        f"the reference speaks against it: on the part held out the {vote.what} was {vote.errors.before:.3g} "
        f"{vote.unit} rms and is {vote.errors.after:.3g}"
        for vote in claim.votes
        if vote.against
    )


def nameless(claim: Claim) -> tuple[str, ...]:
    """A name explains more than a force without one, which may be anything, and not by so little that the two would not
    be told apart.
    """
    contest = claim.contest
    if contest is None or not claim.effects or contest.lead > contest.bound:
        return ()
    return (
        "an unknown force of free spectrum predicts the part held out as well: it gains "
        f"{_gain(contest.nameless)} in twice the log-likelihood, what is named {_gain(contest.both)}",
    )


def constant(claim: Claim) -> tuple[str, ...]:
    """An effect of the right form has the same coefficients throughout; of another form, each amplitude, drive and rate
    asks for others.
    """
    return tuple(
        f"{_plain(name)} has other coefficients in each part of the record, by {departure.size:.0%} of their size and "
        "more than noise makes: something else acts like it"
        for name, departure in claim.departures.items()
        if departure.size > _SET.constant and departure.chance < THRESHOLDS.criterion.chance
    )


def apart(claim: Claim) -> tuple[str, ...]:
    """Each line has a source of its own; two that lie to either side of the vibration have one, which modulates it."""
    return tuple(
        f"{_plain(one.below)} and {_plain(one.above)} lie {one.distance:.4g} Hz to either side of the vibration: "
        "something that modulates it acts like them"
        for one in claim.sidebands
    )


def one_curve(effects: Iterable[str]) -> tuple[str, ...]:
    """A curve that takes more than `promises.laws` laws is known, and not what made it: a sentence for each."""
    laws: dict[Characteristic, list[str]] = {}
    for name in effects:
        effect = declared(name)
        if effect is not None and (of := characteristic(effect)) is not None:
            laws.setdefault(of, []).append(name)
    return tuple(
        f"{' and '.join(_plain(kind(name)) for name in names)} are laws of one curve, {of.value}: so many make "
        "any curve, and something acts like them"
        for of, names in laws.items()
        if len(names) > _SET.laws
    )


def outdone(claim: Claim) -> tuple[str, ...]:
    """Where something stood there for sure, a name that does as well as a force without one is good for a part: less
    only if the force is ahead by as much as tells two accounts apart.
    """
    contest, errors = claim.contest, claim.residual
    if contest is None or not errors.before > _SET.floor * errors.floor:
        return nameless(claim)
    return nameless(claim) if contest.lead < -contest.bound else ()


GUARDS: tuple[Callable[[Claim], tuple[str, ...]], ...] = (
    fell, observed, at_floor, signs, beyond_zero, constants, levels, votes, nameless, constant, apart,
)  # fmt: skip
"""All that must hold of what is explained."""

PARTLY: tuple[Callable[[Claim], tuple[str, ...]], ...] = (
    fell, observed, signs, beyond_zero, levels, votes, outdone,
)  # fmt: skip
"""Of what is explained in part: something may be left, and a constant may have taken up some of it."""


def broken(claim: Claim, guards: tuple[Callable[[Claim], tuple[str, ...]], ...] = GUARDS) -> tuple[str, ...]:
    """What stands against a claim, a sentence each; nothing where it holds."""
    return tuple(sentence for guard in guards for sentence in guard(claim))


def holds_in_part(claim: Claim) -> bool:
    """Whether the effects account for most of what stood above the floor, and nothing but what is left is against."""
    return bool(claim.effects) and claim.residual.share >= _SET.part and not broken(claim, PARTLY)


def minor(gains: Mapping[str, float]) -> tuple[str, ...]:
    """Those that are not among the dominant ones."""
    most = max(gains.values(), default=0.0)
    return tuple(name for name, gain in gains.items() if gain < _SET.minor * most)


def weak(effects: Mapping[str, Mapping[str, Estimate]]) -> dict[str, str]:
    """Those that a guard of their own speaks against, and why: of the wrong sign, or they may as well be nothing."""
    return {
        name: reason
        for name, given in effects.items()
        if (reason := wrong_sign(name, given) or may_be_nothing(name, given))
    }


def is_positive(constant: str) -> bool:
    """Whether physics asks a constant of the model to be: the stiffness or the damping of an axis by itself is."""
    return constant in ("kxx", "kyy", "dxx", "dyy")


def acts_like(names: Iterable[str]) -> str:
    """What is said of a part, no more than that."""
    return f"something acts like {' and '.join(_plain(kind(name)) for name in names)}"


def not_named(names: Iterable[str], sentences: Iterable[str]) -> tuple[str, ...]:
    """Sentences on a model with effects that are not named, told as such: its figures stand beside no other."""
    them = " and ".join(_plain(kind(name)) for name in names)
    return tuple(f"with {them}, which is not named: {said}" for said in sentences) if them else tuple(sentences)


def wrong_sign(name: str, coefficients: Mapping[str, Estimate]) -> str | None:
    """Why an effect with these coefficients is none of its name, None where it may be."""
    if wrong := unphysical({name: coefficients}):
        return f"{_plain(name)} fits only with {wrong}, which would be something else"
    return None


def turned(name: str, coefficients: Mapping[str, Estimate]) -> str | None:
    """What is said of an effect whose gain is that of a channel the other way round, None where none is."""
    axes = [symbol[-1] for symbol, estimate in coefficients.items() if estimate.is_polarity]
    if not axes:
        return None
    both = " and ".join(axes)
    return f"{_plain(name)} of {both} is a polarity: {both} {'are' if axes[1:] else 'is'} driven or sensed reversed"


def may_be_nothing(name: str, coefficients: Mapping[str, Estimate]) -> str | None:
    """Why an effect with these coefficients may as well be absent, None where it is there."""
    sizes = [one for one in coefficients.values() if not one.shape]
    if not sizes or any(one.low > 0.0 or one.high < 0.0 for one in sizes):
        return None
    return f"{_plain(name)} may as well be nothing: the 95 % intervals of its coefficients hold zero"


def contradicted(level: Level) -> str | None:
    """Why a range is none, None where all that was seen lies in it."""
    margin = _SET.never * level.noise
    for end, seen, outside in (
        (level.high, level.highest, level.highest > level.high + margin),
        (level.low, level.lowest, level.lowest < level.low - margin),
    ):
        if outside:
            unit = level.unit
            return f"{_plain(level.effect)} ends at {end:.4g} {unit}, and the part held out reads {seen:.4g} {unit}"
    return None


def conflict(constant: Constant) -> str | None:
    """Why the device cannot have such a constant, None where it may."""
    if constant.positive and constant.high < 0.0:
        return f"{constant.name} comes out negative, {constant.value:.4g}: such a device would move by itself"
    reach = _SET.declared * constant.deviation
    if constant.high < constant.declared - reach or constant.low > constant.declared + reach:
        off = abs(constant.value - constant.declared) / constant.deviation if constant.deviation > 0.0 else math.inf
        return (
            f"{constant.name} comes out at {constant.value:.4g}, {off:.3g} standard deviations from the declared "
            f"{constant.declared:.4g}: correct the bench file, or something else takes its place"
        )
    return None


def _gain(value: float) -> str:
    return f"{value:.4g}".replace("-", "−")


def _over(errors: Errors) -> str:
    return f"{_times(errors.after, errors)} × the noise floor"


def _times(value: float, errors: Errors) -> str:
    return f"{value / errors.floor:.4g}" if errors.floor > 0.0 else "many"


def _plain(name: str) -> str:
    return name.replace("_", " ")
