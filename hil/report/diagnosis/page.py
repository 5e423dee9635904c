"""Puts the page of a trace together and writes it."""

from collections.abc import Callable
from dataclasses import dataclass
from html import escape
from pathlib import Path

from estimator import diagnosis as traced
from estimator.missing_force.result import MissingForce
from estimator.record import Record
from estimator.settings import Device, ObserverSettings
from hil.numbers import count, counted, quantity, sensed, significant, with_and
from hil.records.atomic import write_text
from hil.records.diagnosis import Diagnosis
from hil.records.runfolder import RunFolder
from hil.report import markup
from hil.report.diagnosis import missing_force, tables
from hil.report.diagnosis.equations import typeset
from hil.report.diagnosis.evidence import (
    evidence_figure,
    held_out_figure,
    held_out_spectrum_figure,
    intervals_figure,
    residual_level_figure,
)
from hil.report.diagnosis.material import Material
from hil.report.diagnosis.tables import force_coefficients
from hil.report.markup import Figures
from hil.report.theme import Drawing
from hil.report.verdict import Headline, facts_of_trace
from hil.verdict.next_step import after_trace

_WORDS = {
    "adequate": ("good", "Adequate"),
    "explained": ("good", "Explained"),
    "partly explained": ("open", "Partly explained"),
    "unexplained": ("bad", "Unexplained"),
}
_SAYS = {
    "adequate": "The residual contains nothing that the model would have to explain",
    "explained": "The model lacked an effect; with it, it predicts the rest of the record",
    "partly explained": "Effects of the catalogue explain a part of the residual, and something else is missing too",
    "unexplained": "No effect of the catalogue explains the residual",
}


@dataclass(frozen=True)
class Pictures:
    effect: str = ""
    error: str = ""
    force: str = ""
    candidates: str = ""


def write_report(
    folder: Path,
    found: traced.Diagnosis,
    diagnosis: Diagnosis,
    record: Record,
    device: Device,
    settings: ObserverSettings,
    force: MissingForce | None = None,
    capture: Path | None = None,
) -> Path:
    """Write `folder/report.html`, whole or not at all, and return its path.

    found: the engine's answer about `record`; diagnosis: the same as written; device, settings: the model as it was;
    force: what it lacks, without a name, where that was asked; capture: the file that was traced.
    """
    material = Material(found, diagnosis, record, device, settings, force)
    figures = Figures()

    def drawn(*draw: Callable[[Material], Drawing | None]) -> str:
        return "".join(figures.add(lambda one=one: one(material)) for one in draw)  # type: ignore[misc]

    pictures = Pictures(
        effect=drawn(intervals_figure),
        error=drawn(held_out_figure, residual_level_figure, held_out_spectrum_figure),
        force=drawn(missing_force.draw_fast, missing_force.draw_slow),
        candidates=drawn(evidence_figure),
    )
    held_out = f"{significant(100 * (1 - diagnosis.split / diagnosis.samples), 2)} % held out"
    length_s = float(record.time[-1])
    told = ("Record", f"{significant(length_s)} s", f"{count(diagnosis.samples)} samples, {held_out}")
    return write_page(folder, diagnosis, pictures, told, f"{significant(length_s, 4)} s", capture=capture)


def write_page(
    folder: Path,
    diagnosis: Diagnosis,
    pictures: Pictures,
    record: tuple[str, str, str],
    length: str,
    *,
    declarable: bool = True,
    capture: Path | None = None,
) -> Path:
    """Write `folder/report.html` from the diagnosis as written and the figures, whole or not at all, and return its
    path.

    record: the last of the key figures; length: of the record, in a few words; declarable: whether a bench file can
    declare the effects; capture: the file that was traced.
    """
    bench_text = RunFolder(folder).bench_text
    tone, word = _WORDS[diagnosis.verdict]
    said = (
        *diagnosis.prepared,
        *diagnosis.reasons,
        *diagnosis.undetermined,
        *map(tables.probable, diagnosis.probabilities),
    )
    why = (markup.paragraph(markup.sentence(reason)) for reason in said)
    partly = diagnosis.verdict == "partly explained"
    error = "Error before and after" if diagnosis.effects else "Error"
    sections = [
        markup.section("why", "Why", *why),
        markup.section(
            "effect",
            "What the missing part acts like" if partly else _missing(diagnosis),
            equations_of(diagnosis, declarable=declarable),
            tables.coefficients(diagnosis),
            tables.dependences(diagnosis),
            pictures.effect,
        ),
        markup.section("unconfirmed", "Best candidate, not confirmed", tables.unconfirmed(diagnosis)),
        markup.section("line", "Straight line", tables.line(diagnosis)),
        markup.section("error", error, tables.fits(diagnosis), pictures.error),
        markup.section("force", "The missing force, without a name", *_force(diagnosis, pictures.force)),
        markup.section("left", "What is left", tables.findings(diagnosis.left, diagnosis.sense_unit)),
        markup.section("residual", _held(diagnosis), tables.findings(diagnosis.findings, diagnosis.sense_unit)),
        markup.section("alike", "What this record does not separate", tables.separations(diagnosis)),
        markup.section("candidates", "Candidates", pictures.candidates, tables.rejected(diagnosis)),
        markup.section("bench", "Bench file as traced", markup.listing(bench_text)),
    ]
    page = markup.page(
        kind="Gyro bench · trace",
        title=diagnosis.record,
        line=Headline(tone, word, headline(diagnosis)),
        key=markup.key_figures([*_key_figures(diagnosis), record]),
        sections="".join(sections),
        verdict=markup.verdict((), after_trace(folder, diagnosis, record=capture)),
        facts=facts_of_trace(folder, diagnosis, length),
    )
    write_text(folder / "report.html", page)
    return folder / "report.html"


def headline(diagnosis: Diagnosis) -> str:
    if diagnosis.fault:
        return markup.sentence(diagnosis.reasons[0]).rstrip(".")
    if not diagnosis.effects:
        unexplained = diagnosis.verdict == "unexplained" and diagnosis.reasons
        return _SAYS[diagnosis.verdict] + (f": {diagnosis.reasons[0]}" if unexplained else "")
    titles = [effect.title[0].lower() + effect.title[1:].rstrip(".") for effect in diagnosis.effects]
    before, after = diagnosis.held_out.before.ratio, diagnosis.held_out.after.ratio
    partly = diagnosis.verdict == "partly explained"
    said = f"Something acts like: {with_and(titles)}" if partly else f"The model lacks: {with_and(titles)}"
    if partly and diagnosis.share is None:
        said += "; without it a constant of the model is one that the device cannot have, and the residual is the noise"
    elif before is not None and after is not None:
        them, they = ("it", "it raises") if len(titles) == 1 else ("them", "they raise")
        falls = "falls" if after < before else "goes"
        said += (
            f"; {they} 2 ln L by {_evidence(diagnosis)}"
            if _is_as_before(diagnosis)
            else f"; with {them} the residual {falls} from {significant(before)} to {significant(after)} × the noise "
            "floor"
        )
    if partly and diagnosis.share is not None:
        said += f", {significant(100.0 * diagnosis.share)} % of its power above the floor"
    if diagnosis.separations:
        others = sorted({pair.with_.replace("_", " ") for pair in diagnosis.separations})
        said += (
            f"; on this record {'it' if len(titles) == 1 else 'one'} cannot be distinguished from {with_and(others)}"
        )
    return said


def _is_as_before(diagnosis: Diagnosis) -> bool:
    """Whether the residual over its floor, in the digits shown, is the same before and after."""
    ratios = (diagnosis.held_out.before.ratio, diagnosis.held_out.after.ratio)
    return len({None if ratio is None else significant(ratio) for ratio in ratios}) == 1


def _evidence(diagnosis: Diagnosis) -> str:
    return with_and(significant(effect.evidence or 0.0) for effect in diagnosis.effects)


def _force(diagnosis: Diagnosis, picture: str) -> tuple[str, ...]:
    found = diagnosis.missing_force
    if found is None:
        return ()
    return markup.paragraph(markup.sentence(found.text)), force_coefficients(found), picture


def _held(diagnosis: Diagnosis) -> str:
    return "What the residual holds without them" if diagnosis.left else "What the residual holds"


def _missing(diagnosis: Diagnosis) -> str:
    return "What the model lacks" if len(diagnosis.effects) < 2 else "What the model lacks: several effects"


def equations_of(diagnosis: Diagnosis, *, declarable: bool = True) -> str:
    """Title, equation and remedy of each effect, as HTML."""
    parts = []
    for effect in diagnosis.effects:
        lines = "".join(f"<div>{typeset(equation)}</div>" for equation in effect.equations)
        key = f" <code>[effects.{escape(effect.name)}]</code>" if declarable else ""
        left = effect.angle_bound_rad
        rest = "" if left is None else f"; the angle stays uncertain by {quantity(left, 'rad')} (95 %)"
        remedy = markup.sentence(("Once declared: " if declarable else "Compensation: ") + effect.compensation + rest)
        parts.append(
            f'<h3>{escape(effect.title.rstrip("."))}{key}</h3><div class="equation" tabindex="0">{lines}</div>'
            f"{markup.paragraph(remedy)}"
        )
    return "".join(parts)


def _key_figures(diagnosis: Diagnosis) -> list[tuple[str, str, str]]:
    before, after = diagnosis.held_out.before, diagnosis.held_out.after
    changed = bool(diagnosis.effects)
    entries: list[tuple[str, str, str]] = []
    parted = changed and not _is_as_before(diagnosis)
    if changed and not parted:
        entries.append(("Evidence", _evidence(diagnosis), "2 ln L, on the fitted part"))
    for what, fit in (("Residual before" if parted else "Residual", before), ("Residual after", after)):
        if fit.ratio is not None and (parted or fit is before):
            entries.append(
                (
                    what,
                    f"{significant(fit.ratio)} ×",
                    f"the noise floor; {_rms(fit.innovation_rms, diagnosis.sense_unit)}",
                )
            )
    for what, was, now, unit in (
        ("Angle error", before.angle_error_rms_rad, after.angle_error_rms_rad, "rad"),
        ("Rate error", before.rate_error_rms_rad_s, after.rate_error_rms_rad_s, "rad/s"),
        ("Free run, error", before.simulation_rmse, after.simulation_rmse, diagnosis.sense_unit),
    ):
        if was is not None and now is not None and changed:
            entries.append((what, sensed(now, unit), f"rms; before {sensed(was, unit)}"))
    if diagnosis.angle_moved_rad is not None:
        by = "what was found" if changed else "the fitted candidate that is not named"
        entries.append(("The angle moves by", quantity(diagnosis.angle_moved_rad, "rad"), f"largest change, by {by}"))
    return entries


def _rms(value: float | None, unit: str) -> str:
    return "" if value is None else f"{sensed(value, unit)} rms"


def write_pool_report(folder: Path, diagnosis: Diagnosis) -> Path:
    """Write `folder/report.html`, whole or not at all, and return its path."""
    fitted, rest = count(diagnosis.split), count(diagnosis.samples - diagnosis.split)
    record = ("Records", count(diagnosis.samples), f"samples, {fitted} fitted, {rest} held out with their records")
    return write_page(folder, diagnosis, Pictures(), record, counted(diagnosis.samples, "sample"))
