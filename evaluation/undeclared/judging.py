"""What tracing said of a record beside what the record really was."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from evaluation.undeclared.calibration import Statement, most_probable
from evaluation.undeclared.expected import Expected, expected

NOTHING = "(nothing)"
NOTHING_MISSING, SOMETHING_ELSE = "nothing", "something else"
"""As diagnosis.json calls them among its probabilities."""
AT_FLOOR = 1.1
"""Times the noise floor that an innovation may be which is explained: what the word promises."""


@dataclass(frozen=True)
class Judgement:
    """One record judged.

    truth: names of what was hidden; verdict; named: what tracing named, in its order; right_class: per hidden
    effect whether it is in the class of an effect named; first_class, first_member: the same of the effect named
    first, by class and exactly; alone: the effect named first has no ambiguity group; covered: per coefficient
    and searched parameter of the effects named exactly, whether its 95 % interval holds the truth; error: of those,
    the estimate's deviation in half-widths; after: innovation on the held-out part over the true noise; broken: it is
    called explained and the innovation of the held-out part rose, or is above `AT_FLOOR` times its floor; bounded: a
    verdict of nothing bounds the hidden effect's coefficients, and the bounds hold; proposes: an experiment that
    would tell is named; statements: for each list of probabilities, the one of the account that is called the most
    probable and whether that account is the truth.
    """

    name: str
    category: str
    truth: tuple[str, ...]
    verdict: str
    named: tuple[str, ...]
    right_class: tuple[bool, ...]
    first_class: bool
    first_member: bool
    alone: bool
    covered: Mapping[str, bool]
    error: Mapping[str, float]
    before: float | None
    after: float | None
    broken: bool
    bounded: bool
    proposes: bool
    innovation_ratio: float | None
    statements: tuple[Statement, ...] = ()

    @property
    def row(self) -> str:
        """Of the confusion matrix."""
        return " + ".join(self.truth) or NOTHING

    @property
    def column(self) -> str:
        """Of the confusion matrix: what was named first, or the verdict where nothing was."""
        return self.named[0] if self.verdict == "explained" and self.named else self.verdict

    @property
    def right(self) -> bool:
        """The best answer of its category: the class named first; nothing named where nothing is to be named, or what
        acts like it, with what is left.
        """
        nothing = ("adequate",)
        best = {"clean": nothing, "never": nothing, "outside": ("unexplained", "partly explained")}.get(self.category)
        return self.first_class if best is None else self.verdict in best

    @property
    def surplus(self) -> int:
        """How many more effects were named than hidden."""
        return max(len(self.named) - len(self.truth), 0)

    @property
    def misnamed(self) -> bool:
        """A wrong name, without reserve."""
        return self.verdict == "explained" and self.alone and not self.first_class


def judge(truth: Mapping[str, Any], diagnosis: Mapping[str, Any] | None) -> Judgement:
    """Judge a diagnosis (None: tracing gave none) by truth.json."""
    hidden = [expected(one["name"], one["tables"], one["sections"], truth["device"]) for one in truth["effects"]]
    said = diagnosis or {"verdict": "refused", "effects": [], "ambiguity_groups": [], "rejected": []}
    named = tuple(plain(effect["name"]) for effect in said["effects"])
    classes = [class_of(name, said["ambiguity_groups"]) for name in named]
    known = [what for what in hidden if what.names]
    first = set(known[0].names) if len(known) == 1 else {name for what in known for name in what.names}
    covered: dict[str, bool] = {}
    error: dict[str, float] = {}
    for effect in said["effects"]:
        for what in known:
            if plain(effect["name"]) in what.names:
                for symbol, true in {**what.coefficients, **what.parameters}.items():
                    _compare(effect, symbol, true, covered, error)
    noise = truth["noise_V"]
    bounded = bool(known) and all(_bounded(what, said["rejected"]) for what in known)
    held_out = said.get("held_out", {})
    return Judgement(
        name=truth["name"],
        category=truth["category"],
        truth=tuple(one["name"] for one in truth["effects"]),
        verdict=said["verdict"],
        named=named,
        right_class=tuple(bool(set(what.names) & set().union(*classes)) for what in hidden),
        first_class=bool(classes) and bool(first & classes[0]),
        first_member=bool(named) and named[0] in first,
        alone=bool(classes) and len(classes[0]) == 1,
        covered=covered,
        error=error,
        before=_over(held_out.get("before"), noise),
        after=_over(held_out.get("after"), noise),
        broken=said["verdict"] == "explained" and not _kept(held_out),
        bounded=bounded,
        proposes=any(pair["separate_by"] for pair in said.get("separations", ())),
        innovation_ratio=truth["innovation_ratio"],
        statements=_statements(said, _accounts(truth["category"], known, bounded)),
    )


def _accounts(category: str, known: list[Expected], bounded: bool) -> frozenset[str]:
    """What the account that is called the most probable may be: what was hidden; of what shows so little that the
    record bounds it, and of what is never to be named, nothing; else, outside the catalogue, something else.
    """
    if category in ("clean", "never"):
        return frozenset({NOTHING_MISSING})
    if not known:
        return frozenset({SOMETHING_ELSE})
    hidden = frozenset(name for what in known for name in what.names)
    return hidden | {NOTHING_MISSING} if category == "calm" and bounded else hidden


def _statements(said: Mapping[str, Any], true: frozenset[str]) -> tuple[Statement, ...]:
    alike = [frozenset(map(plain, group)) for group in said["ambiguity_groups"]]
    stated = []
    for entry in said.get("probabilities", ()):
        members, probability = most_probable(entry, alike)
        stated.append((probability, bool(members & true)))
    return tuple(stated)


def _kept(held_out: Mapping[str, Any]) -> bool:
    before, after = (held_out[when] for when in ("before", "after"))
    fell = after["innovation_rms"] < before["innovation_rms"]
    return bool(fell and after["ratio"] is not None and after["ratio"] <= AT_FLOOR)


def class_of(name: str, ambiguity_groups: Iterable[Iterable[str]]) -> set[str]:
    """An effect and all that the record cannot tell from it."""
    groups = [set(map(plain, group)) for group in ambiguity_groups]
    return {name}.union(*(group for group in groups if name in group))


def plain(name: str) -> str:
    """Without the label that tells several of a kind apart."""
    return name.partition(":")[0]


def _compare(
    effect: Mapping[str, Any], symbol: str, true: float, covered: dict[str, bool], error: dict[str, float]
) -> None:
    for given, interval in effect["coefficients"].items():
        low, high = interval["ci95"]
        if plain(given) == symbol and low is not None and high is not None and symbol not in covered:
            covered[symbol] = low <= true <= high
            error[symbol] = (interval["value"] - true) / (0.5 * (high - low)) if high > low else math.inf


def _over(fit: Mapping[str, Any] | None, noise_V: float) -> float | None:
    rms = None if fit is None else fit["innovation_rms"]
    return None if rms is None else rms / noise_V


def _bounded(what: Expected, rejected: list[Mapping[str, Any]]) -> bool:
    """Whether the effect was turned down with bounds that its coefficients keep."""
    for one in rejected:
        if plain(one["name"]) in what.names and one.get("bound"):
            held: dict[str, bool] = {}
            for symbol, true in what.coefficients.items():
                _compare({"coefficients": one["bound"]}, symbol, true, held, {})
            if held:
                return all(held.values())
    return False
