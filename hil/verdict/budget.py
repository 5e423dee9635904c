"""The angle's uncertainty budget, after JCGM 100 (GUM): one row a source, at the end of the scored window.

The sources and what they contribute as declared are those of every row of the estimates (`hil.verdict.uncertainty`).
The scan that closes a run adds what its record says: what it leaves of each constant, what nobody declared, what is
lacking.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from estimator.uncertainty import SinceZero
from hil.bench import Bench
from hil.bench.calibration import SYMBOLS
from hil.bench.classic import PLUGIN as CLASSIC
from hil.bench.loop import LEAST_ROWS
from hil.inputs.declared import formula_of
from hil.numbers import COVERAGE, SD_95, quantity, significant
from hil.records.estimates import Estimates
from hil.records.result import Angle, Contribution, Lacking, Scan
from hil.verdict.uncertainty import DAMPING, ESTIMATION, Sources, source_of

if TYPE_CHECKING:
    from estimator.completeness.information import Information

UNDECLARED = "undeclared effects"
LACKING = "what the model lacks"
_EFFECTS = {"sense_gain": "sense_gain_ratio"} | {name: name for name in SYMBOLS if name != "clock"}
"""Effects of the catalogue that are constants of the calibration, where their names differ too."""


class Budget(NamedTuple):
    """What result.json says of the angle: the angle, its uncertainty, standard and expanded, and where that comes
    from."""

    angle: Angle | None
    angle_u_rad: float | None
    angle_expanded_rad: float | None
    uncertainty: tuple[Contribution, ...]


_NOTHING = Budget(None, None, None, ())


def budget(
    estimates: Estimates | None, bench: Bench, information: "Information | None" = None, scan: Scan | None = None
) -> Budget:
    """The budget of a recorded run; `information` is what its closing scan learned of the record, `scan` what it said.

    Nothing (None, no rows) where no angle is reported, or where it is not finite.
    """
    if estimates is None or "angle_u_rad" not in estimates:
        return _NOTHING
    scored = estimates.settled(bench.loop.settle_s)
    if len(scored) < LEAST_ROWS:
        return _NOTHING
    ends = scored.part(0, 1), scored.part(len(scored) - 1, len(scored))
    deviation = float(ends[1]["angle_sd_rad"][0])
    angle = _angle(scored, bench)
    if angle is None or not math.isfinite(deviation):
        not_given = angle is not None and math.isnan(deviation) and "observer" in estimates.header.get("plugins", {})
        return Budget(angle, None, None, ()) if not_given else _NOTHING
    sources = Sources(bench)
    rows = contributions(bench, sources, deviation, _course(*ends, sources), information, scan)
    total = combined(rows)
    return Budget(angle, total, COVERAGE * total, tuple(rows))


def combined(rows: Sequence[Contribution]) -> float:
    """Standard uncertainty [rad] of an angle by its budget."""
    return math.sqrt(sum(row.contribution_rad**2 for row in rows))


def contributions(
    bench: Bench,
    sources: Sources,
    deviation: float,
    course: SinceZero,
    information: "Information | None" = None,
    scan: Scan | None = None,
) -> list[Contribution]:
    """The rows of an angle's budget, the largest first: deviation [rad] is that by estimation, `course` what happened
    since the angle was zero; `information` and `scan` as of `budget`.
    """
    declared = {source: math.sqrt(each) for source, each in sources.variances(deviation, course).items()}
    found = [] if scan is None else [*scan.lacks, *scan.harmless]
    strange = [item for item in found if not _constants_of(item)]
    if information is not None and (scan is None or _holds(scan, strange)):
        known = bench.device.known
        u = {name: item.u for name, item in known.items()}
        left = {source_of(name): contribution for name, contribution in _left(information, u).items()}
        if bench.observer.plugin == CLASSIC:  # what a constant does depends on where their pattern was
            declared |= {source_of(name): contribution for name, contribution in _moved(information, u).items()}
        beyond = _beyond(bench, information if strange else replace(information, found=None))
    else:  # of a model that lacks something a scan is a rough guide: what is declared counts whole, and what it found
        left, beyond = {}, _lacking(strange)
    rows = [*_rows(bench, sources, course, declared, left, _measured(found)), *beyond]
    return sorted(rows, key=lambda row: -row.contribution_rad)


def _holds(scan: Scan, strange: list[Lacking]) -> bool:
    """Whether what the scan says of coefficients holds: the model lacks nothing, or constants of the calibration only,
    which it was linearised about.
    """
    return scan.complete is True or (bool(scan.lacks) and not strange)


def _constants_of(item: Lacking) -> list[str]:
    """The constants of the calibration that something lacking may be."""
    return [_EFFECTS[name] for name in (item.effect, *item.alike) if name in _EFFECTS]


def _measured(found: list[Lacking]) -> dict[str, float]:
    """Constants of the calibration that the scan measured, by source: what they were found to do, in place of what is
    declared of them.
    """
    return {source_of(name): _rms(item) for item in found for name in _constants_of(item)[:1]}


def _rms(item: Lacking) -> float:
    """How far the angle is off for what was found, rms."""
    return math.hypot(item.angle_rad, (item.angle_ci95[1] - item.angle_rad) / SD_95)


def _angle(scored: Estimates, bench: Bench) -> Angle | None:
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
    # Of a plug-in nobody knows what it takes off for drive forces.
    pattern = scored.header.get("angle") != "rate" and "observer" not in scored.header.get("plugins", {})
    return Angle(
        kind="pattern" if scored.header.get("angle") != "rate" else "rate",
        why=formula_of(bench).why,
        rad=float(last[0]),
        plain_rad=float(last[2]) if pattern else None,
        control_imperfection_rms_rad=math.sqrt(squares / len(scored)) if pattern else None,
    )


def _course(first: Estimates, last: Estimates, sources: Sources) -> SinceZero:
    """What happened between two rows of the estimates."""

    def between(name: str) -> float:
        return float(last[name][0] - first[name][0])

    return sources.course(
        float(last.t_s[0] - first.t_s[0]),
        between("angle_rad"),
        between("angle_forced_rad"),
        float(last["kxy_per_s2"][0]),
        tuple(float(last[f"d{axes}_per_s"][0]) for axes in ("xx", "yy", "xy")),
    )


def _rows(
    bench: Bench,
    sources: Sources,
    course: SinceZero,
    declared: Mapping[str, float],
    left: Mapping[str, float],
    found: Mapping[str, float],
) -> list[Contribution]:
    """One row for each source, as declared [rad]; of a constant that the scan tested, what the record leaves of it, and
    of one that it found to be off, what that does.
    """
    words = _words(course)
    constants = bench.device.known
    known = {source_of(name): item for name, item in constants.items()}
    rows = []
    for source, contribution in declared.items():
        value, unit, assumed = contribution, "rad", False
        how = _HOW.get(bench.observer.plugin, _GIVEN)
        if source == DAMPING:
            assert sources.damping_sd_per_s is not None
            value, unit = sources.damping_sd_per_s, "1/s"
            how = f"¼ of a difference between the axes, √2 of them, for {quantity(course.seconds, 's')}"
        elif source != ESTIMATION:
            value, unit, assumed = known[source]
            by_scan = bench.observer.plugin == CLASSIC and source in left
            how = "of each axis × what it does to these loops' angle, by the scan" if by_scan else words[source]
            how += f" = {quantity(contribution, 'rad', 2)}"
        if source in found:
            how += f"; the scan found {quantity(found[source], 'rad', 2)}"
        elif source in left:
            how += f"; the record leaves {quantity(left[source], 'rad', 2)} of it"
        rows.append(
            Contribution(
                source=source,
                value=value,
                unit=unit,
                sensitivity=how,
                contribution_rad=found.get(source, left.get(source, contribution)),
                declared_rad=contribution,
                assumed=assumed,
                found=source in found,
            )
        )
    return rows


_GIVEN = "1: as the plug-in gives it"
_HOW: Mapping[str | None, str] = {
    None: "1: covariance of the estimate, and of the constants used to subtract the rotation by drive forces",
    CLASSIC: "1: demodulated noise of the loops, the turn by damping as declared and as uncertain "
    "([observer.initial_sd] damping), and in mode_reversal the rate's change over each exchange for as long as the "
    "rate was held",
}


def _words(course: SinceZero) -> Mapping[str, str]:
    forced, turned = quantity(abs(course.forced), "rad"), quantity(abs(course.rotation), "rad")
    drag = quantity(math.hypot(*course.damping[:2]) / 4.0, "rad/s", 2)
    late = f"{significant(abs(course.stiffness_xy) / 4.0, 4)} rad/s²"
    seconds = quantity(course.seconds, "s")
    return {
        "drive gain": f"of each axis × half the rotation by drive forces, {forced}",
        "sense gain ratio": f"× half the rotation by drive forces, {forced}, and half a radian at the sense output",
        "sense interface": f"of each axis' amplitude × half the rotation by drive forces, {forced}, and half a radian",
        "drive misalignment": f"of each axis × a quarter of the damping, {drag} of both, × {seconds}",
        "sense cross coupling": f"of each axis × a quarter of the damping, {drag} of both, × {seconds}",
        "drive delay": f"of each axis × a quarter of the cross-stiffness, {late}, × {seconds}",
        "sense delay": f"of each axis × a quarter of the cross-stiffness, {late}, × {seconds}",
        "clock": f"× twice the rotation by drive forces, {forced}",
        "angular gain": f"× rotation, {turned}",
    }


def _beyond(bench: Bench, information: "Information") -> list[Contribution]:
    """What may be there and nobody declared, as large and as probable as the record leaves it, and what was found to be
    there and is not held against the run.
    """
    effect, course = with_clock(information).beyond(bench.device.calibration.by_symbol(bench.device.resonance_rad_s))
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
            sensitivity=f"1: at most one effect, each as probable and as large as the record allows; largest: {name}"
            + (f"; {quantity(found, 'rad', 2)} by what the scan found and calls harmless" if found else ""),
            contribution_rad=contribution,
        )
    ]


def _lacking(items: list[Lacking]) -> list[Contribution]:
    """What the scan found and the model lacks: the angle is off by it, as far as anybody knows."""
    if not items:
        return []
    contribution = sum(map(_rms, items))
    return [
        Contribution(
            source=LACKING,
            value=contribution,
            unit="rad",
            sensitivity=f"1: {', '.join(item.effect.replace('_', ' ') for item in items)}, as the scan found it",
            contribution_rad=contribution,
        )
    ]


def _moved(information: "Information", declared: Mapping[str, float]) -> dict[str, float]:
    """What each tested constant contributes as declared, rad, by name, as the scan followed the angle."""
    joint = with_clock(information)
    return {
        name: u * float(np.linalg.norm(joint.sensitivity[-1, joint.columns(SYMBOLS[name])]))
        for name, u in declared.items()
        if name in SYMBOLS and all(map(joint.watches, SYMBOLS[name]))
    }


def _left(information: "Information", declared: Mapping[str, float]) -> dict[str, float]:
    """What each constant contributes after the record, rad, by name; those that were not tested are left out.

    What is uncertain of all of them together, gᵀ C g, is divided among them by g_k (C g)_k: of two that the record
    tells only together, each has its share of what they have left together.
    """
    joint = with_clock(information)
    tested = {
        name: symbols for name, symbols in SYMBOLS.items() if name in declared and all(map(joint.watches, symbols))
    }
    sd = {symbol: declared[name] for name, symbols in tested.items() for symbol in symbols}
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
    return {name: math.sqrt(sum(by_symbol[symbol] for symbol in symbols)) for name, symbols in tested.items()}


def with_clock(information: "Information") -> "Information":
    """The same with one more coefficient, "clock": a board that runs fast by δ drives both axes as if their gains were
    less by 2δ each.
    """
    from estimator.completeness.information import ScannedCoefficient

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
        coefficients=(*information.coefficients, ScannedCoefficient("clock", "clock", "1", plausible)),
        normal=mixed.T @ information.normal @ mixed,
        score=mixed.T @ information.score,
        sensitivity=information.sensitivity @ plain,
    )


def largest_source(row: Contribution) -> str:
    """The largest row, and the U that there would be by it alone."""
    told = " (assumed)" if row.assumed else ""
    return f"{row.source}{told}, U = {quantity(COVERAGE * row.contribution_rad, 'rad', 2)}"
