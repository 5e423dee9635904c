"""The words of a diagnosis, and the figures behind them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

from estimator.diagnosis import Diagnosis, Rejected, Unconfirmed, Verdict
from estimator.scaling import Array
from estimator.side_by_side import side_by_side
from estimator.trace.angle import AngleReader
from estimator.trace.checks import Check, Evidence
from estimator.trace.chosen import Chosen
from estimator.trace.determined import undetermined
from estimator.trace.examination import Examination
from estimator.trace.named import effects_of, found_of
from estimator.trace.pairs import pairs_of
from estimator.trace.probabilities import probabilities
from estimator.trace.problem import Problem
from estimator.trace.rejected import Failed, rejected

MOST = 0.5
"""Of the power above the noise floor, that effects have to account for which explain a part."""
READ = 100_000
"""Samples over which the angle is read with and without an effect."""


@dataclass(frozen=True)
class Judged:
    """A model and what the checks say of it; after: what the bench's observer makes of the record with it; share: of
    the residual's power above the noise floor on the part held out, what its effects account for, None where none are
    named or none stood above it; failed: effects that a check took out of the model again.
    """

    evidence: Evidence
    checks: list[Check]
    after: Examination
    share: float | None
    failed: Mapping[str, Failed]

    @property
    def named(self) -> list[str]:
        """Effects that the bench file does not declare."""
        return list(self.evidence.without)

    @property
    def verdict(self) -> Verdict:
        """The word for it."""
        return verdict_of(self.named, self.checks, self.share)


def verdict_of(named: list[str], checks: list[Check], share: float | None = None) -> Verdict:
    """The word for what the checks say; share: of the residual's power above the noise floor that the effects account
    for, None where none stood above it.
    """
    failed = [check for check in checks if not check.passed]
    if not failed:
        return Verdict.EXPLAINED if named else Verdict.ADEQUATE
    in_part = named and not any(check.effect for check in failed) and (share is None or share > MOST)
    return Verdict.PARTLY if in_part else Verdict.UNEXPLAINED


def diagnosis(
    problem: Problem, split: int, chosen: Chosen, judged: Judged, before: Examination,
    progress: Callable[[str, int, int], None],
) -> Diagnosis:  # fmt: skip
    """What a trace answers: the words, and the figures behind them."""
    evidence, checks, after = judged.evidence, judged.checks, judged.after
    named, model, share, verdict = judged.named, evidence.model, judged.share, judged.verdict
    reader = AngleReader(problem.part(slice(0, min(split, READ))))
    carried = effects_of(model)
    effects = tuple(side_by_side([partial(found_of, name, evidence, carried, reader) for name in named]))
    groups = {name: chosen.groups[name] for name in named}
    others = rejected(evidence.of, problem.device, chosen.found, groups, judged.failed)
    unconfirmed = None
    if verdict is Verdict.UNEXPLAINED and named:
        failed = tuple(check.sentence for check in checks if not check.passed)
        unconfirmed, effects, groups, share = Unconfirmed(effects, failed, after.held_out), (), {}, None
    return Diagnosis(
        verdict=verdict, effects=effects,
        separations=pairs_of(problem, model, groups, reader, effects, others, progress),
        rejected=others, findings=before.findings,
        before=before.fitted, after=after.fitted, held_out_before=before.held_out, held_out_after=after.held_out,
        residual_before=before.residual, residual_after=after.residual, split=split, reasons=reasons_of(judged, others),
        angle_moved=reader.moved(problem.effects, carried) if effects and problem.device.axes == 2 else None,
        share=share, left=after.findings if verdict is Verdict.PARTLY else (),
        probabilities=probabilities(evidence, checks, chosen.groups, chosen.found),
        undetermined=undetermined(model), unconfirmed=unconfirmed, free_run=_shown(evidence),
    ).of_what_is_named()  # fmt: skip


def _shown(evidence: Evidence) -> tuple[Array, Array] | None:
    """Of a run that nothing corrects, measured less simulated over the part held out, before and after."""
    if evidence.of.following is evidence.of:
        return None
    return evidence.before.innovation, evidence.held_out.innovation


def share_of(evidence: Evidence) -> float | None:
    """Of the residual's power above the noise floor on the part held out, what goes; None where none stood above it."""
    was, now = evidence.before_ratio**2, evidence.floor_ratio**2
    return 1.0 - max(now - 1.0, 0.0) / (was - 1.0) if was > 1.0 else None


def reasons_of(judged: Judged, others: tuple[Rejected, ...]) -> tuple[str, ...]:
    """Why the verdict is what it is: checks that failed first, then what else was seen on the part held out."""
    failed = [check.sentence for check in judged.checks if not check.passed]
    passed = [check.sentence for check in judged.checks if check.passed and check.name in ("noise floor", "held out")]
    other = "other " if judged.named else ""
    tested = f"{len(others)} {other}kinds of effects were tested; none gains more than chance beside the model"
    return (*failed, *passed, *([] if failed else [tested]))
