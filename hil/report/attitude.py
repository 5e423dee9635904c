"""The page of several gyros run at once: attitude over time, what it is made of, what stopped all."""

from pathlib import Path

import numpy as np

from hil.numbers import COVERAGE, quantity, significant
from hil.records.atomic import write_text
from hil.records.attitude import AttitudeRecord, AttitudeResult, load_attitude_result
from hil.report import markup
from hil.report.markup import Figures
from hil.report.theme import FIRST, INK, MUTED, SECOND, Drawing, legend, span_time, stacked
from hil.report.verdict import Headline

_TONES = {"good": "good", "interrupted": "open"}


def write_attitude_report(folder: Path) -> Path:
    """Write `folder/report.html` and return its path."""
    result = load_attitude_result(folder)
    record = AttitudeRecord.read(folder / "attitude.arrow") if (folder / "attitude.arrow").exists() else None
    drawn = "" if record is None else Figures().add(lambda: _figure(record))
    page = markup.page(
        kind="Gyro bench · attitude",
        title=folder.name,
        line=Headline(_TONES.get(result.verdict, "bad"), result.verdict, _sentence(result)),
        key=markup.key_figures(_key(result)),
        sections=markup.section("attitude", "Attitude", drawn, _told(result))
        + markup.section("axes", "Axes", _axes(result)),
    )
    write_text(folder / "report.html", page)
    return folder / "report.html"


def _sentence(result: AttitudeResult) -> str:
    if result.stop is not None:
        return f"All were stopped by {result.stop.by}."
    return f"There is no attitude: {result.without}." if result.without else "All runs ended as asked."


def _key(result: AttitudeResult) -> list[tuple[str, str, str]]:
    if result.quaternion is None or result.u_rad is None or result.coning_rad is None or result.seconds is None:
        return []
    turned = 2.0 * float(np.arccos(min(abs(result.quaternion[0]), 1.0)))
    return [
        ("turned", quantity(turned, "rad"), f"after {quantity(result.seconds, 's')}"),
        ("U, k = 2", quantity(COVERAGE * result.u_rad, "rad"), "of the attitude, three axes together"),
        ("coning", quantity(result.coning_rad, "rad"), "corrected between samples"),
    ]


def _told(result: AttitudeResult) -> str:
    if result.quaternion is None:
        return markup.paragraph(f"No attitude: {result.without}.") if result.without else ""
    shown = ", ".join(significant(one, 6) for one in result.quaternion)
    return markup.paragraph(
        f"At the end the quaternion, scalar first, is ({shown}). It turns a vector of the body's frame into that of "
        "the reference, the body at the start. Each two increments of the angles give a rotation vector, with two "
        "thirds of their cross product for the coning."
    )


def _axes(result: AttitudeResult) -> str:
    rows = []
    for one in result.axes:
        safe = "" if result.stop is None else result.stop.safe_after_s.get(one.name)
        rows.append(
            (
                one.name,
                one.run,
                one.verdict or "",
                ", ".join(f"{part:g}" for part in one.direction),
                "" if one.angle_rad is None else quantity(one.angle_rad, "rad"),
                "" if one.angle_u_rad is None else quantity(one.angle_u_rad, "rad", 2),
                "one" if one.clock_u_s is None else quantity(one.clock_u_s, "s", 2),
                quantity(safe, "s", 2) if isinstance(safe, float) else "",
            )
        )
    head = ("axis", "run", "verdict", "direction", "angle", "u", "clock, u", "SAFE after")
    return markup.table("The gyros of the body", head, rows)


def _figure(record: AttitudeRecord) -> Drawing:
    """Rotation vector of the attitude with its 95 % band; below, the standard uncertainty and the coning."""
    q = record.quaternion * np.where(record.quaternion[:, :1] < 0.0, -1.0, 1.0)
    norm = np.linalg.norm(q[:, 1:], axis=1)
    vector = 2.0 * np.arctan2(norm, q[:, 0])[:, None] * q[:, 1:] / np.maximum(norm, 1e-30)[:, None]
    figure, (above, below) = stacked(3.7, (1.4, 1.0))
    for k, (name, colour) in enumerate(zip("xyz", (FIRST, SECOND, MUTED), strict=True)):
        half = COVERAGE * np.sqrt(record.columns[f"c_{name}{name}_rad2"])
        above.fill_between(record.t_s, vector[:, k] - half, vector[:, k] + half, color=colour, alpha=0.2, linewidth=0)
        above.plot(record.t_s, vector[:, k], color=colour, label=f"rotation vector, {name}")
    above.set_ylabel("rotation / rad")
    legend(above)
    below.plot(record.t_s, 1e3 * record.columns["u_rad"], color=INK, label="standard uncertainty")
    below.plot(record.t_s, 1e3 * np.linalg.norm(record.coning, axis=1), color=FIRST, label="coning")
    below.set_ylabel("mrad")
    legend(below)
    span_time([above, below], [0.0, float(record.t_s[-1])])
    caption = "Rotation vector of the body from its start, with bands of 95 %, and what of it is coning."
    return Drawing(figure, "Attitude", caption, f"{caption} It ends at {vector[-1]} rad.")
