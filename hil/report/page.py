"""Puts the page together and writes it."""

from collections.abc import Callable
from html import escape
from importlib.resources import files
from pathlib import Path

from hil.records.atomic import write_text
from hil.records.runfolder import RunFolder
from hil.records.truth import Truth, read_truth
from hil.report import markup, tables
from hil.report.figures import angle, innovation, parameters, pattern, rate, signals, spectrum, timing
from hil.report.figures.drawing import Drawing
from hil.report.inline_svg import inline_svg
from hil.report.material import Material
from hil.report.theme import drawing_style
from hil.report.verdict import headline, key_figures

_ANGLES = "The reported angle φ is +∫Ω dt; the pattern turns the other way in the board's frame, θ = −φ + constant."
_INTERVALS = (
    "Scoring starts where the shading of the figures ends. "
    "Bands and intervals are 95 %, from the observer's own covariance."
)


def write_report(run: Path, truth: Path | None = None) -> Path:
    """Write `run/report.html`, whole or not at all, and return its path.

    `truth` is the emulator's truth file; only the score passes it on. Without it the record's own rate
    channel is the reference, if it has one. Figures whose records are missing are left out. Raises InputError
    for a folder without records or a record that is not one.
    """
    folder = RunFolder.open(run)
    page = render(folder, None if truth is None else read_truth(truth))
    write_text(folder.report_path, page)
    return folder.report_path


def render(folder: RunFolder, truth: Truth | None = None) -> str:
    """The page as text."""
    material = Material(folder, truth)
    figures = _Figures(material)
    line = headline(material.result)
    sections = [
        markup.section("angle", "Angle", figures.draw(angle.draw), tables.angle(material)),
        markup.section("rate", "Rate", figures.draw(rate.draw)),
        markup.section(
            "parameters",
            "Parameters",
            tables.parameters(material),
            figures.draw(parameters.draw),
            tables.coverage(material),
        ),
        markup.section("vibration", "Vibration", figures.draw(pattern.draw), figures.draw(signals.draw)),
        markup.section("innovation", "Innovation", figures.draw(innovation.draw), figures.draw(spectrum.draw)),
        markup.section("timing", "Timing and link", figures.draw(timing.draw), tables.counters(material)),
        markup.section("run", "Run", tables.provenance(material), _conventions(material)),
        markup.section("bench", "Bench file as run", _listing(folder)),
    ]
    template = files("hil.report").joinpath("page.html").read_text(encoding="utf-8")
    values = {
        "title": escape(material.result.run),
        "style": files("hil.report").joinpath("style.css").read_text(encoding="utf-8"),
        "tone": line.tone,
        "word": escape(line.word),
        "sentence": escape(line.sentence),
        "key": markup.key_figures(key_figures(material.result)),
        "sections": "".join(sections),
    }
    for name, value in values.items():
        template = template.replace(f"<!-- {name} -->", value)
    return template


class _Figures:
    """Draws figures one after another and numbers those that exist."""

    def __init__(self, material: Material) -> None:
        self._material = material
        self._count = 0

    def draw(self, module: Callable[[Material], Drawing | None]) -> str:
        with drawing_style():
            drawing = module(self._material)
            if drawing is None:
                return ""
            self._count += 1
            svg = inline_svg(drawing.figure, f"f{self._count}", drawing.title, drawing.alt)
        return markup.figure(self._count, drawing.title, drawing.caption, svg)


def _conventions(material: Material) -> str:
    turns = material.estimates is not None and "angle_rad" in material.estimates
    return (markup.paragraph(_ANGLES) if turns else "") + markup.paragraph(_INTERVALS)


def _listing(folder: RunFolder) -> str:
    return markup.listing(folder.bench_text) if folder.bench_text else ""
