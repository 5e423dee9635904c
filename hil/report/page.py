"""Puts the page together and writes it."""

from collections.abc import Mapping
from pathlib import Path

from hil.numbers import COVERAGE, magnitude, quantity, together
from hil.records.atomic import write_text
from hil.records.runfolder import RunFolder
from hil.records.truth import Truth, read_truth
from hil.report import markup, tables
from hil.report.drawn import draw_figures
from hil.report.markup import paragraph, table
from hil.report.material import Material
from hil.report.verdict import alarm, facts, headline, key_figures, next_step, parts

_ANGLES = "The reported angle φ is +∫Ω dt. In the frame of the board the pattern rotates backwards: θ = −φ + constant."
_INTERVALS = (
    "Scoring starts where the shading of the figures ends. "
    "Bands and intervals are 95 %, from the observer's own covariance."
)


def write_report(
    run: Path,
    truth: Path | None = None,
    *,
    earlier: tuple[Path, Path] | None = None,
    drawn: Mapping[str, str] | None = None,
) -> Path:
    """Write `run/report.html`, whole or not at all, and return its path.

    `truth` is the emulator's truth file; only the score passes it on. Without it the record's own rate
    channel is the reference, if it has one. `earlier` is a run without what its trace found, and its truth; `drawn`
    are figures of `draw_figures` that are there already.
    Figures whose records are missing are left out. Raises InputError for a folder without records or a record
    that is not one.
    """
    folder = RunFolder.open(run)
    before = None if earlier is None else Material(RunFolder.open(earlier[0]), read_truth(earlier[1]))
    page = render(folder, None if truth is None else read_truth(truth), before, drawn)
    write_text(folder.report_path, page)
    return folder.report_path


def render(
    folder: RunFolder,
    truth: Truth | None = None,
    earlier: Material | None = None,
    drawn: Mapping[str, str] | None = None,
) -> str:
    material = Material(folder, truth, earlier)
    drawn = draw_figures(material) if drawn is None else drawn

    line = headline(material.result)
    sections = [
        markup.section("closing", "What the residual shows", _told(material), drawn["closing_figure"]),
        markup.section("angle", "Angle", drawn["angle_figure"], uncertainty_section(material), tables.angle(material)),
        markup.section("rate", "Rate", drawn["rate_figure"]),
        markup.section("on-the-board", "On the board", tables.on_board(material)),
        markup.section(
            "parameters",
            "Parameters",
            tables.parameters(material),
            drawn["parameters_figure"],
            drawn["trims_figure"],
            tables.coverage(material),
        ),
        markup.section("vibration", "Vibration", drawn["pattern_figure"], drawn["signals_figure"]),
        markup.section(
            "innovation",
            "Innovation",
            drawn["prediction_figure"],
            drawn["innovation_figure"],
            drawn["innovation_spectrum_figure"],
        ),
        markup.section(
            "timing",
            "Timing and link",
            drawn["turnaround_figure"],
            tables.answers(material),
            tables.ledger(material),
            tables.algorithm(material),
            tables.counters(material),
        ),
        markup.section("run", "Run", tables.provenance(material), _conventions(material)),
        markup.section("bench", "Bench file as run", tables.device(material), markup.listing(folder.bench_text)),
    ]
    return markup.page(
        kind="Gyro bench · run report",
        title=material.result.run,
        line=line,
        key=markup.key_figures(key_figures(material.result, None if earlier is None else earlier.result)),
        sections="".join(sections),
        alarm=alarm(material.result),
        verdict=markup.verdict(parts(material.result), next_step(material.result)),
        facts=facts(material.result, folder.bench),
    )


def _told(material: Material) -> str:
    """What a trace found before this run, when it carries the finding."""
    if material.result.diagnosis is None:
        return ""
    from hil.report.trace import told  # loads what declares the effects: only where there is something to tell

    return told(material)


def _conventions(material: Material) -> str:
    turns = material.estimates is not None and "angle_rad" in material.estimates
    return (markup.paragraph(_ANGLES) if turns else "") + markup.paragraph(_INTERVALS)


def uncertainty_section(material: Material) -> str:
    """Angle ± U, the source's own angle beside it, and the table of what U is made of; nothing without an angle."""
    result = material.result
    if result.angle is not None and result.angle_expanded_rad is None:
        told = f"At the end of the scored window the angle is {_both(result.angle.rad)}, zero at its start, by "
        return paragraph(f"{told}{result.angle.why}. Its uncertainty is not given.")
    if result.angle is None or result.angle_expanded_rad is None:
        open_loop = material.estimates is not None and material.estimates.header.get("angle") == "none"
        return paragraph(f"{result.parts['angle'].reason}.") if open_loop and "angle" in result.parts else ""
    angle = result.angle
    said = (
        f"At the end of the scored window the angle is {_both(angle.rad)} ± {_both(result.angle_expanded_rad)} (k = 2, "
        "about 95 %), zero at its start."
    )
    if angle.plain_rad is not None and angle.control_imperfection_rms_rad is not None:
        said += (
            " The patent's formula (11), which subtracts the virtual rotation only, gives "
            f"{_both(angle.plain_rad)}. Rotation by drive forces (already subtracted): "
            f"{_both(angle.control_imperfection_rms_rad)} rms."
        )
    if angle.why:
        said += f" The angle is computed by {angle.why}."
    *sizes, expanded = together(
        [*(row.contribution_rad for row in result.uncertainty), result.angle_expanded_rad], "rad"
    )
    rows = [
        (
            row.source + (" (assumed)" if row.assumed else ""),
            size,
            magnitude(row.value) if row.unit == "1" else quantity(row.value, row.unit),
            row.sensitivity,
        )
        for row, size in zip(result.uncertainty, sizes, strict=True)
    ]
    rows.append((f"expanded, k = {COVERAGE:g}", expanded, "", "twice the root of the sum of squares"))
    head = ("source", "contribution", "standard uncertainty", "how it reaches the angle")  # what a phone shows first
    return paragraph(said) + table("Uncertainty budget of the angle", head, rows, (1, 2))


def _both(angle_rad: float) -> str:
    return quantity(angle_rad, "rad")
