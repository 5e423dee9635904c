"""The angle's uncertainty budget, after JCGM 100 (GUM): one row a source, at the end of the scored window."""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from estimator.uncertainty import Course, sensitivities
from hil.bench import Bench
from hil.numbers import quantity, significant
from hil.records.estimates import Estimates
from hil.records.result import Angle, Contribution

if TYPE_CHECKING:
    from estimator.completeness.information import Information

COVERAGE = 2.0
"""Factor k of the expanded uncertainty: about 95 % for what is nearly normal."""

ESTIMATION = "estimation"
DAMPING = "declared damping"
UNDECLARED = "undeclared effects"
_SYMBOLS = {
    "drive_gain": ("hx", "hy"),
    "sense_gain_ratio": ("gy",),
    "drive_misalignment": ("mx", "my"),
    "sense_cross_coupling": ("ex", "ey"),
    "drive_delay": ("tux", "tuy"),
    "sense_delay": ("tsx", "tsy"),
    "clock": ("clock",),
}
"""Constants that a scan watches, by the symbols of their coefficients in the catalogue; the clock as made here."""


class Budget(NamedTuple):
    """What result.json says of the angle: the angle, its expanded uncertainty, and where that comes from."""

    angle: Angle | None
    angle_u_rad: float | None
    uncertainty: tuple[Contribution, ...]


def budget(estimates: Estimates | None, bench: Bench, information: "Information | None" = None) -> Budget:
    """The budget of a recorded run; `information` is what its closing scan learned of the record.

    Nothing (None, no rows) where no angle is reported, or where it is not finite.
    """
    if estimates is None or "angle_u_rad" not in estimates:
        return Budget(None, None, ())
    scored = estimates.since(bench.loop.settle_s)
    if len(scored) < 2:
        return Budget(None, None, ())
    ends = scored.part(0, 1), scored.part(len(scored) - 1, len(scored))
    deviation = float(ends[1]["angle_sd_rad"][0])
    angle = _angle(scored)
    if angle is None or not math.isfinite(deviation):
        return Budget(None, None, ())
    course = _course(*ends, bench)
    rows = [_estimation(deviation, bench), *_calibration(bench, course, information)]
    if information is not None:
        rows += _beyond(bench, information)
    if bench.observer.variant == "sense":
        rows.append(_damping(bench, course))
    total = math.sqrt(sum(row.contribution_rad**2 for row in rows))
    rows.sort(key=lambda row: -row.contribution_rad)
    return Budget(angle, COVERAGE * total, tuple(rows))


def _angle(scored: Estimates) -> Angle | None:
    """The reported angle at the end, zero at the start, and the source's own beside it."""
    names = [f"angle_{name}rad" for name in ("", "pattern_", "plain_")]
    start = np.array([scored.part(0, 1)[name][0] for name in names])
    last, squares = start, 0.0
    with np.errstate(all="ignore"):  # of an observer that diverged: there is no angle then
        for piece in scored.pieces():
            moved = np.stack([piece[name] for name in names]) - start[:, None]
            if not np.isfinite(moved).all():
                return None
            last, squares = moved[:, -1], squares + float(np.sum((moved[1] - moved[0]) ** 2))
    if not math.isfinite(squares):
        return None
    pattern = scored.header.get("angle") != "rate"
    return Angle(
        kind="pattern" if pattern else "rate",
        rad=float(last[0]),
        plain_rad=float(last[2]) if pattern else None,
        control_imperfection_rms_rad=math.sqrt(squares / len(scored)) if pattern else None,
    )


def _course(first: Estimates, last: Estimates, bench: Bench) -> Course:
    """What happened between two rows of the estimates; in open loop no force turned anything."""
    driven = 1.0 if bench.controller.enabled else 0.0

    def between(name: str) -> float:
        return float(last[name][0] - first[name][0])

    xx, yy, xy = (driven * float(last[f"d{axes}_per_s"][0]) for axes in ("xx", "yy", "xy"))
    return Course(
        seconds=float(last.t_s[0] - first.t_s[0]),
        rotation=between("angle_rad"),
        forced=driven * between("angle_forced_rad"),
        stiffness_xy=driven * float(last["kxy_per_s2"][0]),
        damping=(xx, yy, xy),
        angular_gain=bench.device.calibration.angular_gain,
    )


def _estimation(deviation: float, bench: Bench) -> Contribution:
    return Contribution(
        source=ESTIMATION,
        value=deviation,
        unit="rad",
        sensitivity="1: covariance of the estimate, with that of the constants by which forces are taken off"
        if bench.controller.enabled
        else "1: covariance of the integrated rate",
        contribution_rad=deviation,
    )


def _damping(bench: Bench, course: Course) -> Contribution:
    """Of the observer of 7 states, which takes the parameters as known: what it is told of the damping."""
    device = bench.device
    mean = sum(device.damping_per_s[:2]) / 2.0
    value = bench.observer.initial_sd.damping * mean
    return Contribution(
        source=DAMPING,
        value=value,
        unit="1/s",
        sensitivity=f"¼ of a difference between the axes, √2 of them, for {quantity(course.seconds, 's')}",
        contribution_rad=0.25 * math.sqrt(2.0) * value * course.seconds / course.angular_gain,
    )


def _calibration(bench: Bench, course: Course, information: "Information | None") -> list[Contribution]:
    """One row for each constant: by the closed form, or where the scan watched it, what the record leaves of it."""
    known = bench.device.calibration.known(bench.device.resonance_rad_s)
    left = {} if information is None else _left(information, {name: item.u for name, item in known.items()})
    words = _words(course)
    rows = []
    for name, square in sensitivities(course).items():
        item = known[name]
        declared = math.sqrt(square) * item.u
        contribution = left.get(name, declared)
        rows.append(
            Contribution(
                source=name.replace("_", " "),
                value=item.u,
                unit=item.unit,
                sensitivity=f"{words[name]} = {quantity(declared, 'rad', 2)}"
                + (f"; the record leaves {quantity(contribution, 'rad', 2)} of it" if name in left else ""),
                contribution_rad=contribution,
                assumed=item.assumed,
            )
        )
    return rows


def _words(course: Course) -> Mapping[str, str]:
    forced, turned = quantity(abs(course.forced), "rad"), quantity(abs(course.rotation), "rad")
    drag = quantity(math.hypot(*course.damping[:2]) / 4.0, "rad/s", 2)
    late = f"{significant(abs(course.stiffness_xy) / 4.0, 4)} rad/s²"
    seconds = quantity(course.seconds, "s")
    return {
        "drive_gain": f"of each axis × half the forced rotation, {forced}",
        "sense_gain_ratio": f"× half the forced rotation, {forced}, and half a radian where it is read",
        "drive_misalignment": f"of each axis × a quarter of the damping, {drag} of both, × {seconds}",
        "sense_cross_coupling": f"of each axis × a quarter of the damping, {drag} of both, × {seconds}",
        "drive_delay": f"of each axis × a quarter of the cross-stiffness, {late}, × {seconds}",
        "sense_delay": f"of each axis × a quarter of the cross-stiffness, {late}, × {seconds}",
        "clock": f"× twice the forced rotation, {forced}",
        "angular_gain": f"× rotation, {turned}",
    }


def _beyond(bench: Bench, information: "Information") -> list[Contribution]:
    """What may be there and nobody declared: of all effects the one that may move the angle most, as large as the
    record allows, and what was found to be there and is not held against the run.
    """
    declared = bench.device.calibration.known(bench.device.resonance_rad_s)
    sd = {symbol: declared[name].u for name, symbols in _SYMBOLS.items() for symbol in symbols}
    effect, course = with_clock(information).beyond(sd)
    contribution = float(np.max(course))  # at the end it may just be passing through zero, as sin 2θ does
    if not effect or not math.isfinite(contribution):
        return []
    found = 0.0 if information.found is None else float(np.max(information.found))
    name = effect.partition(":")[0].replace("_", " ")
    return [
        Contribution(
            source=UNDECLARED,
            value=contribution,
            unit="rad",
            sensitivity=f"1: {name}, were it there and as large as the record allows, at most"
            + (f"; {quantity(found, 'rad', 2)} by what the scan found and calls harmless" if found else ""),
            contribution_rad=contribution,
        )
    ]


def _left(information: "Information", declared: Mapping[str, float]) -> dict[str, float]:
    """What each constant contributes after the record, rad; constants that were not watched are left out.

    What is uncertain of all of them together, gᵀ C g, is divided among them by g_k (C g)_k: of two that the record
    tells only together, each has its share of what they have left together.
    """
    joint = with_clock(information)
    sd = {
        symbol: declared[name]
        for name, symbols in _SYMBOLS.items()
        if all(map(joint.watches, symbols))
        for symbol in symbols
    }
    if not sd:
        return {}
    found = joint.posterior(sd)
    g = found.sensitivity[-1]
    second = found.covariance + np.outer(found.mean, found.mean)
    shares = np.maximum(g * (second @ g), 0.0)
    total = float(g @ second @ g)
    whole = float(shares.sum())
    if not math.isfinite(total) or whole <= 0.0:
        return {}
    by_symbol = dict(zip(found.symbols, shares * (total / whole), strict=True))
    return {
        name: math.sqrt(sum(by_symbol[symbol] for symbol in symbols))
        for name, symbols in _SYMBOLS.items()
        if all(symbol in by_symbol for symbol in symbols)
    }


def with_clock(information: "Information") -> "Information":
    """The same with one more coefficient, "clock": a board that runs fast by δ drives both axes as if their gains were
    less by 2δ each.
    """
    from dataclasses import replace

    from estimator.completeness.information import Coefficient

    if not (information.watches("hx") and information.watches("hy")):
        return information
    places = information.columns(["hx", "hy"])
    plausible = information.coefficients[places[0]].plausible
    added = np.zeros((len(information.coefficients), 1))
    for place in places:
        added[place] = -2.0 * plausible / information.coefficients[place].plausible
    mixed = np.hstack([np.eye(len(added)), added])
    size = np.array([c.plausible for c in information.coefficients] + [plausible])
    plain = size[:-1, None] * mixed / size
    return replace(
        information,
        coefficients=(*information.coefficients, Coefficient("clock", "clock", "1", plausible)),
        normal=mixed.T @ information.normal @ mixed,
        score=mixed.T @ information.score,
        sensitivity=information.sensitivity @ plain,
    )


def remedy(row: Contribution, bench: Bench) -> str:
    """The setting, or the act, that lowers a row."""
    controller = bench.controller
    if row.source in ("drive gain", "sense gain ratio", "clock") and controller.virtual_rotation_rad_s != 0.0:
        if controller.virtual_reversal_s == 0.0:
            period = abs(math.pi / controller.virtual_rotation_rad_s)
            return f"set [controller] virtual_reversal_s = {period:.2g}, so that a gain error cancels, and run again"
        return "set a smaller [controller] virtual_rotation_rad_s, or virtual_reversal_s, and run again"
    if row.source == ESTIMATION:
        return "raise [observer] memory_s, lower [observer.process_noise] as far as the device allows, and run again"
    if row.source == UNDECLARED:
        return "excite the device more ([controller] amplitude_modulation, dither_mps2), or hil trace, and run again"
    if row.source == DAMPING:
        return "measure the damping, and say how well with [observer.initial_sd] damping"
    key = f"{row.source.replace(' ', '_')}_u{'_s' if row.unit == 's' else ''}"
    return f"calibrate it, and declare how well with [device.calibration] {key}"
