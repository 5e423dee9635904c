"""Puts the page of a trace together and writes it."""

from html import escape
from pathlib import Path

from estimator.settings import Device, ObserverSettings
from estimator.trace import diagnosis as traced
from estimator.trace.record import Record
from hil.records.atomic import write_text
from hil.records.diagnosis import Diagnosis
from hil.report import markup
from hil.report.diagnosis import dependence, evidence, intervals, level, spectrum, tables
from hil.report.diagnosis.equations import typeset
from hil.report.diagnosis.material import Material
from hil.report.numbering import Figures
from hil.report.numbers import count, quantity, significant

_WORDS = {"adequate": ("good", "Adequate"), "explained": ("good", "Explained"), "unexplained": ("bad", "Unexplained")}
_SAYS = {
    "adequate": "Nothing stands in the residual that the model would have to explain",
    "explained": "The model lacked an effect, and with it the rest of the record is foretold",
    "unexplained": "Something stands in the residual, and nothing in the catalogue accounts for it",
}


def write_report(
    folder: Path,
    found: traced.Diagnosis,
    diagnosis: Diagnosis,
    record: Record,
    device: Device,
    settings: ObserverSettings,
) -> Path:
    """Write `folder/report.html`, whole or not at all, and return its path.

    found: the engine's answer about `record`; diagnosis: the same as written; device, settings: the model as it was.
    """
    listing = folder / "bench.toml"
    text = listing.read_text(encoding="utf-8") if listing.exists() else ""
    material = Material(found, diagnosis, record, device, settings, text)
    path = folder / "report.html"
    write_text(path, render(material))
    return path


def render(material: Material) -> str:
    """The page as text."""
    diagnosis = material.diagnosis
    figures = Figures()
    tone, word = _WORDS[diagnosis.verdict]
    sections = [
        markup.section("why", "Why", *(markup.paragraph(_sentence(reason)) for reason in diagnosis.reasons)),
        markup.section("effect", _missing(diagnosis), equations_of(diagnosis), tables.coefficients(diagnosis),
                       figures.add(lambda: intervals.draw(material))),
        markup.section("error", "Error before and after" if material.changed else "Error", tables.fits(diagnosis),
                       figures.add(lambda: level.draw(material)), figures.add(lambda: spectrum.draw(material))),
        markup.section("residual", "What the residual holds", tables.findings(diagnosis),
                       figures.add(lambda: dependence.draw(material))),
        markup.section("alike", "What this record cannot tell apart", tables.confusable(diagnosis)),
        markup.section("candidates", "Candidates", figures.add(lambda: evidence.draw(material)),
                       tables.rejected(diagnosis)),
        markup.section("bench", "Bench file as traced",
                       markup.listing(material.bench_text) if material.bench_text else ""),
    ]  # fmt: skip
    return markup.page(
        kind="Gyro bench · trace of a residual",
        title=f"{diagnosis.bench}: {diagnosis.record}",
        tone=tone,
        word=word,
        sentence=headline(diagnosis),
        key=markup.key_figures(_key_figures(material)),
        sections="".join(sections),
    )


def headline(diagnosis: Diagnosis) -> str:
    """The answer in one sentence."""
    if not diagnosis.effects:
        return _SAYS[diagnosis.verdict]
    titles = [effect.title[0].lower() + effect.title[1:].rstrip(".") for effect in diagnosis.effects]
    before, after = diagnosis.held_out.before.ratio, diagnosis.held_out.after.ratio
    said = f"The model lacks: {', and '.join(titles)}"
    if before is not None and after is not None:
        said += f"; with it the residual falls from {significant(before)} to {significant(after)} × the noise floor"
    if diagnosis.confusable:
        others = sorted({pair.with_.replace("_", " ") for pair in diagnosis.confusable})
        said += f"; on this record it cannot be told from {', '.join(others)}"
    return said


def _missing(diagnosis: Diagnosis) -> str:
    return "What the model lacks" if len(diagnosis.effects) < 2 else "What the model lacks: several effects"


def equations_of(diagnosis: Diagnosis) -> str:
    """Title, equation and cure of each effect, as HTML."""
    parts = []
    for effect in diagnosis.effects:
        lines = "".join(f"<div>{typeset(equation)}</div>" for equation in effect.equations)
        parts.append(
            f"<h3>{escape(effect.title.rstrip('.'))} <code>[effects.{escape(effect.name)}]</code></h3>"
            f'<div class="equation">{lines}</div>{markup.paragraph(_sentence("Once declared: " + effect.undone))}'
        )
    return "".join(parts)


def _key_figures(material: Material) -> list[tuple[str, str, str]]:
    diagnosis = material.diagnosis
    before, after = diagnosis.held_out.before, diagnosis.held_out.after
    entries: list[tuple[str, str, str]] = []
    if before.ratio is not None:
        entries.append(
            (
                "Residual before" if material.changed else "Residual",
                f"{significant(before.ratio)} ×",
                f"the noise floor; {_volts(before.innovation_rms)}",
            )
        )
    if material.changed and after.ratio is not None:
        entries.append(
            ("Residual after", f"{significant(after.ratio)} ×", f"the noise floor; {_volts(after.innovation_rms)}")
        )
    for what, was, now, unit in (
        ("Angle error", before.angle_error_rms_rad, after.angle_error_rms_rad, "rad"),
        ("Rate error", before.rate_error_rms_rad_s, after.rate_error_rms_rad_s, "rad/s"),
        ("Free run, error", before.simulation_rmse, after.simulation_rmse, "V"),
    ):
        if was is not None and now is not None and material.changed:
            entries.append((what, quantity(now, unit), f"rms; before {quantity(was, unit)}"))
    seconds = float(material.record.time[-1])
    entries.append(
        (
            "Record",
            f"{significant(seconds)} s",
            f"{count(diagnosis.samples)} samples, {significant(100 * (1 - diagnosis.split / diagnosis.samples), 2)} % "
            "held out",
        )
    )
    return entries


def _volts(value: float | None) -> str:
    return "" if value is None else f"{quantity(value, 'V')} rms"


def _sentence(text: str) -> str:
    first = text.split(" ", 1)[0]
    return (text if "_" in first else text[:1].upper() + text[1:]).rstrip(".") + "."
