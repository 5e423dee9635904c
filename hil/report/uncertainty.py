"""The angle's uncertainty budget on the page."""

from hil.numbers import magnitude, quantity, together
from hil.records.coverage import COVERAGE
from hil.report.markup import paragraph, table
from hil.report.material import Material


def section(material: Material) -> str:
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
