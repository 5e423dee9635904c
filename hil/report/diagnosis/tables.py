"""The tables of the page of a trace."""

import math
from collections.abc import Mapping, Sequence

from hil.numbers import count, percent, plus_minus, quantity, sensed, significant
from hil.records.diagnosis import (
    Coefficient,
    Dependence,
    Diagnosis,
    Finding,
    FormTerm,
    MissingForce,
    Probabilities,
    Unconfirmed,
)
from hil.report.markup import table
from hil.report.tables import shown_unit

_SHOWN = 0.01  # probability from which on an account is listed
_FIGURES = {
    "innovation_rms": ("residual, rms", "V"),
    "noise_floor": ("noise floor", "V"),
    "ratio": ("residual over floor", ""),
    "whiteness_p": ("white? Ljung–Box p", ""),
    "simulation_rmse": ("free run, rms error", "V"),
    "angle_error_rms_rad": ("angle error, rms", "rad"),
    "rate_error_rms_rad_s": ("rate error, rms", "rad/s"),
}
"""Figure of a `Fit` → how it is called, and its unit."""


def fits(diagnosis: Diagnosis) -> str:
    """Before and after, fitted and held out; where nothing was added there is one of each."""
    head, rows = fit_rows(diagnosis)
    floor = floor_from(diagnosis)
    caption = (
        f"{floor}Fitted: {count(diagnosis.split)} samples of {count(diagnosis.samples)}. Held out: the rest, "
        "which was not used for the choice"
    )
    return table(caption, head, rows, range(1, len(head)))


def floor_from(diagnosis: Diagnosis) -> str:
    """How the noise floors of the table were found, a sentence; "" for a diagnosis of before that was kept."""
    parts = (("fitted", diagnosis.before.floor_from), ("held out", diagnosis.held_out.before.floor_from))
    sources = dict.fromkeys(source for _, source in parts if source)
    if not sources:
        return ""
    told = next(iter(sources)) if len(sources) == 1 else "; ".join(f"{part}, {source}" for part, source in parts)
    return f"Noise floor: from {told}. "


def fit_rows(diagnosis: Diagnosis) -> tuple[list[str], list[tuple[str, ...]]]:
    """The same as words: headings, and a row for each figure that is known."""
    columns = [diagnosis.before, diagnosis.after, diagnosis.held_out.before, diagnosis.held_out.after]
    head = ["", "fitted, before", "after", "held out, before", "after"]
    if not diagnosis.effects:
        columns, head = columns[::2], ["", "fitted", "held out"]
    rows = []
    for key, (label, unit) in _FIGURES.items():
        values: list[float | None] = [getattr(fit, key) for fit in columns]
        if any(value is not None for value in values):
            own = diagnosis.sense_unit if unit == "V" else unit
            rows.append((label, *(_chance(value) if key == "whiteness_p" else _shown(value, own) for value in values)))
    return head, rows


def coefficients(diagnosis: Diagnosis, truth: Mapping[str, float | None] | None = None) -> str:
    """What was found, SI per unit mass; `truth` by symbol, where a run that carries it has been scored."""
    known = {symbol: value for symbol, value in (truth or {}).items() if value is not None}
    several = len(diagnosis.effects) > 1
    rows = [
        [
            symbol,
            _estimate(found),
            *([_true(found, known.get(symbol))] if known else []),
            interval(found),
            shown_unit(found.unit),
            *([effect.title] if several else []),
        ]
        for effect in diagnosis.effects
        for symbol, found in effect.coefficients.items()
    ]
    true, of = ["truth"] if known else [], ["of"] if several else []
    head = ["coefficient", "estimate", *true, "95 % interval", "unit", *of]
    caption = "Coefficients, SI per unit mass, ± half of the 95 % interval"
    return table(caption, head, rows, range(1, len(head) - 1 - len(of))) if rows else ""


def unconfirmed(diagnosis: Diagnosis) -> str:
    """The best candidate that a check rejects, with its coefficients."""
    best = diagnosis.unconfirmed
    if best is None:
        return ""
    rows = [
        (_plain(effect.name), symbol, _estimate(found), interval(found), shown_unit(found.unit))
        for effect in best.effects
        for symbol, found in effect.coefficients.items()
    ]
    head = ("candidate", "coefficient", "estimate", "95 % interval", "unit")
    return table(f"Not confirmed, {left_with(best)}: {'; '.join(best.failed)}", head, rows, (2, 3))


def left_with(best: Unconfirmed) -> str:
    """What the residual is with a candidate that is not confirmed."""
    ratio = best.held_out.ratio
    return "" if ratio is None else f"with it the residual held out is {significant(ratio)} × the noise floor"


def line(diagnosis: Diagnosis) -> str:
    """The straight line of a rate sensor, as fitted beside its effects."""
    rows = [(name, _estimate(found), interval(found), shown_unit(found.unit)) for name, found in diagnosis.base.items()]
    caption = "The line V0 + S Ω as fitted, ± half of the 95 % interval"
    return table(caption, ("constant", "estimate", "95 % interval", "unit"), rows, (1, 2)) if rows else ""


def dependences(diagnosis: Diagnosis) -> str:
    """What goes with the covariate of the records."""
    rows = [
        (
            one.name,
            f"{one.covariate} = {significant(one.reference)}",
            estimate(one.at_reference),
            f"{_estimate(one.per_unit)} {shown_unit(one.per_unit.unit)} per {one.covariate}",
            interval(one.per_unit),
        )
        for one in diagnosis.dependences
    ]
    head = ("constant", "at", "value", "changes by", "95 % interval")
    return table("What depends on the covariate, linearly", head, rows, (2, 3, 4)) if rows else ""


def dependence(one: Dependence) -> str:
    """The same of one, in a line."""
    return (
        f"{one.name} = {estimate(one.at_reference)} at {one.covariate} = {significant(one.reference)}, and changes by "
        f"{_estimate(one.per_unit)} {shown_unit(one.per_unit.unit)} with one of {one.covariate}, 95 %"
    )


def findings(found: Sequence[Finding], unit: str = "V") -> str:
    rows = [
        (
            finding.text,
            "" if finding.size_V is None else sensed(finding.size_V, unit),
            "" if finding.significance is None else significant(finding.significance, 2),
        )
        for finding in found
    ]
    caption = "Largest first; σ: significance, corrected for the number of places tested"
    return table(caption, ("in the residual", "rms", "σ"), rows, (1, 2)) if rows else ""


def separations(diagnosis: Diagnosis) -> str:
    """What this record cannot tell apart, and what would."""
    rows = [
        (
            _plain(pair.effect),
            _plain(pair.with_),
            "" if pair.correlation is None else f"{pair.correlation:.5f}",
            pair.separate_by or "nothing known",
            "" if pair.expected is None else f"{pair.expected:.4f}",
            "" if pair.takes_s is None else f"{pair.takes_s:.2g} s",
            "" if pair.angle_apart_rad is None else quantity(pair.angle_apart_rad, "rad"),
        )
        for pair in diagnosis.separations
    ]
    caption = (
        "Effects that this record does not separate; correlation of their signatures here, and in the experiment; how "
        "long that has to last; the largest change of the angle if it is the other"
    )
    head = ("effect", "not separated from", "here", "what separates them", "there", "lasting", "angle")
    return table(caption, head, rows, (2, 4, 5, 6)) if rows else ""


def rejected(diagnosis: Diagnosis) -> str:
    """What was looked at and not taken, and how large it can be at most."""
    rows = [
        (_plain(one.name), one.reason, "; ".join(_bound(symbol, found) for symbol, found in one.bound.items()))
        for one in diagnosis.rejected
    ]
    head = ("candidate", "why not", "its coefficients, 95 %")
    left = ", and what is left for each with the named effect in the model" if diagnosis.effects else ""
    return table(f"Tested and not named{left}", head, rows) if rows else ""


def probable(one: Probabilities) -> str:
    """How probable each account is that has 1 % at least, in a line."""
    shares = [f"{_plain(name)} {percent(share, 0)}" for name, share in one.classes.items() if share >= _SHOWN]
    about = "" if one.effect is None else f" for {_plain(one.effect)}"
    return f"probabilities{about}: {', '.join(shares)}"


def _shown(value: float | None, unit: str) -> str:
    if value is None:
        return "–"
    return sensed(value, unit) if unit else significant(value)


def _chance(value: float | None) -> str:
    if value is None:
        return "–"
    return "< 10⁻³⁰⁰" if value == 0.0 else significant(value, 2)


def estimate(found: Coefficient) -> str:
    """Value, half of its 95 % interval, unit."""
    return f"{_estimate(found)} {shown_unit(found.unit)}".rstrip()


def _true(found: Coefficient, truth: float | None) -> str:
    low, high = found.ci95
    if truth is None:
        return "–"
    if found.value is None or low is None or high is None:
        return significant(truth, 6)
    return plus_minus(found.value, (high - low) / 2.0, beside=truth)


def _estimate(found: Coefficient) -> str:
    low, high = found.ci95
    if found.value is None:
        return "–"
    if low is None or high is None:
        return significant(found.value)
    return plus_minus(found.value, (high - low) / 2.0)


def interval(found: Coefficient) -> str:
    low, high = found.ci95
    if found.value is None or low is None or high is None:
        return " to ".join("unbounded" if end is None else significant(end, 4) for end in found.ci95)
    return " to ".join(plus_minus(found.value, (high - low) / 2.0, beside=end) for end in (low, high))


def _bound(symbol: str, found: Coefficient) -> str:
    low, high = found.ci95
    ends = [end for end in (low, high) if end is not None and math.isfinite(end)]
    if not ends:
        return f"{symbol} unbounded"
    largest = max(abs(end) for end in ends)
    return f"|{symbol}| < {significant(largest, 2)} {shown_unit(found.unit)}".rstrip()


def _plain(name: str) -> str:
    return name.replace("_", " ")


def force_coefficients(found: MissingForce) -> str:
    """Each term of the form with its coefficients."""
    rows = [
        (term.form, name, "reading" if term.sensed else "force", estimate(one), interval(one))
        for term in found.form
        for name, one in term.coefficients.items()
    ]
    rows += [(term.form, name, "inside", estimate(one), "") for term in found.form for name, one in term.inside.items()]
    head = ["term", "of", "in the", "coefficient", "95 % interval"]
    caption = "The form of the missing force: coefficients, SI per unit mass, with the sign with which they push"
    return table(caption, head, rows, (3, 4)) if rows else ""


def force_terms(found: MissingForce) -> list[str]:
    lines = []
    for term in found.form:
        inside = "".join(f", {name} = {estimate(one)}" for name, one in term.inside.items())
        lines += [
            f"{_where(term)}{name}: {estimate(one)} · {term.form}{inside}" for name, one in term.coefficients.items()
        ]
    return lines


def _where(term: FormTerm) -> str:
    return "sensed " if term.sensed else "force on "
