"""What a trace found, told in the report of the run that carries it."""

from hil.numbers import quantity, significant
from hil.records.diagnosis import Diagnosis
from hil.records.result import TOO_SLOW, Result
from hil.report import markup
from hil.report.diagnosis.page import equations_of, headline
from hil.report.diagnosis.tables import coefficients
from hil.report.material import Material


def told(material: Material) -> str:
    """Sentence, equation, coefficients, and the figures of the run before beside those of this one."""
    diagnosis = Diagnosis.model_validate(material.result.diagnosis)
    parts = [
        markup.paragraph(f"Traced in {diagnosis.record}. {headline(diagnosis)}."),
        equations_of(diagnosis),
        coefficients(diagnosis, {name: found.truth for name, found in material.result.parameters.items()}),
    ]
    if material.earlier is not None:
        parts.append(_beside(material.earlier.result, material.result))
    return "".join(parts)


def _beside(before: Result, after: Result) -> str:
    rows = [
        (name, *(_shown(value, unit) for value in pair), _gain(*pair))
        for name, unit, pair in (
            ("angle error, rms", "rad", (before.angle_error_rms_rad, after.angle_error_rms_rad)),
            ("rate error, rms", "rad/s", (before.rate_error_rms_rad_s, after.rate_error_rms_rad_s)),
            ("residual over noise floor", "", (before.residual_ratio, after.residual_ratio)),
        )
    ]
    caption = f"The loop without the effect ({before.run}) and with it ({after.run}), same board, same seed"
    table = markup.table(caption, ("", "before", "after", "smaller"), rows, (1, 2, 3))
    if before.kept_up and after.kept_up:
        return table
    return table + markup.paragraph(f"{TOO_SLOW[:1].upper()}{TOO_SLOW[1:]}.")


def _shown(value: float | None, unit: str) -> str:
    return "–" if value is None else quantity(value, unit) if unit else significant(value)


def _gain(before: float | None, after: float | None) -> str:
    return "" if before is None or not after else f"{significant(before / after, 2)} ×"
