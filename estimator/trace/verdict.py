"""The words of a diagnosis, and the figures behind them."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial

from estimator.diagnosis import Dependence, Diagnosis, Found, Rejected, Unconfirmed, Verdict
from estimator.scaling import Array, Scaling
from estimator.side_by_side import side_by_side
from estimator.thresholds import THRESHOLDS
from estimator.trace.angle import AngleReader
from estimator.trace.checks import Evidence
from estimator.trace.chosen import Chosen
from estimator.trace.determined import undetermined
from estimator.trace.examination import Figures
from estimator.trace.likelihood import Check
from estimator.trace.named import effects_of, found_of
from estimator.trace.pairs import pairs_of
from estimator.trace.pooled_layout import of_records
from estimator.trace.probabilities import probabilities
from estimator.trace.problem import Problem, Progress
from estimator.trace.rejected import Failed, rejected, ruled_out

MOST = THRESHOLDS.criterion.part
"""Of the power above the noise floor, that effects have to account for which explain a part."""


@dataclass(frozen=True)
class Judged:
    """A model and what the checks say of it; after: what the bench's observer makes of the record with it; share: of
    the residual's power above the noise floor on the part held out, what its effects account for, None where none are
    named or none stood above it; failed: effects that a check took out of the model again.
    """

    evidence: Evidence
    checks: list[Check]
    after: Figures
    share: float | None
    failed: Mapping[str, Failed]

    @property
    def named(self) -> list[str]:
        """Effects that the bench file does not declare."""
        return list(self.evidence.without)

    @property
    def against(self) -> tuple[str, ...]:
        """What the checks hold against it."""
        return tuple(check.sentence for check in self.checks if not check.passed)

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


def answer(
    judged: Judged, figures: tuple[Figures, Figures], effects: tuple[Found, ...],
    dependences: tuple[Dependence, ...] = (),
) -> Diagnosis:  # fmt: skip
    """The word with what is named, or what was not confirmed; figures: before and after.  A kind of record adds what it
    knows beside.
    """
    verdict, (before, after), unconfirmed = judged.verdict, figures, None
    if verdict is Verdict.UNEXPLAINED and judged.named:
        unconfirmed = Unconfirmed(effects, judged.against, after.held_out)
        effects, dependences = (), ()
    return Diagnosis(
        verdict=verdict, effects=effects, separations=(), rejected=(), findings=before.findings,
        before=before.fitted, after=after.fitted, held_out_before=before.held_out, held_out_after=after.held_out,
        residual_before=before.residual, residual_after=after.residual, split=0, reasons=(),
        share=None if unconfirmed else judged.share, left=after.findings if effects else (),
        unconfirmed=unconfirmed, dependences=dependences,
    ).of_what_is_named()  # fmt: skip


def diagnosis(
    problem: Problem, split: int, chosen: Chosen, judged: Judged, figures: tuple[Figures, Figures],
    progress: Progress, dependences: tuple[Dependence, ...] = (),
) -> Diagnosis:  # fmt: skip
    """What a trace of a motion answers; dependences: of several records, what goes with their covariate."""
    evidence, model = judged.evidence, judged.evidence.model
    reader = AngleReader.of(problem, figures)
    carried = of_records(effects_of(model))
    named = [name for name in judged.named if name in carried]
    effects = tuple(side_by_side([partial(found_of, name, evidence, carried, reader) for name in named]))
    groups = {name: chosen.groups[name] for name in judged.named}
    others = rejected(evidence.of, chosen.found, groups, judged.failed, Scaling.of(problem.device))
    told = answer(judged, figures, effects, dependences)
    shown = {} if told.unconfirmed else groups
    separations = pairs_of(problem, model, shown, reader, told.effects, others, progress)
    others = ruled_out(others, separations)
    return replace(
        told, separations=separations, rejected=others, split=split, reasons=reasons_of(judged, others),
        angle_moved=reader.moved(problem.effects, carried) if told.effects and problem.device.axes == 2 else None,
        probabilities=probabilities(evidence, judged.checks, chosen.groups, chosen.found),
        undetermined=undetermined(model), free_run=_shown(evidence, told),
    )  # fmt: skip


def _shown(evidence: Evidence, told: Diagnosis) -> tuple[Array, Array] | None:
    """Of one run that nothing corrects, measured less simulated over the part held out, before and after."""
    if evidence.of.following is evidence.of or evidence.held_out.records:
        return None
    return evidence.before.innovation, (evidence.held_out if told.effects else evidence.before).innovation


def share_of(before: float, after: float) -> float | None:
    """Of a residual's power above the noise floor, what goes; None where none stood above it.  Residuals are over that
    floor, rms.
    """
    was, now = before**2, after**2
    return 1.0 - max(now - 1.0, 0.0) / (was - 1.0) if was > 1.0 else None


def reasons_of(judged: Judged, others: tuple[Rejected, ...]) -> tuple[str, ...]:
    """Why the verdict is what it is: checks that failed first, then what else was seen on the part held out."""
    failed = judged.against
    passed = [check.sentence for check in judged.checks if check.passed and check.name in ("noise floor", "held out")]
    other = "other " if judged.named else ""
    tested = f"{len(others)} {other}kinds of effects were tested; none raises 2 ln L by more than chance"
    return (*failed, *passed, *([] if failed else [tested]))
