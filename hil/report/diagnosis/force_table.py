"""The form of a missing force, as a table of the page and as lines of a terminal."""

from hil.records.diagnosis import FormTerm, MissingForce
from hil.report.diagnosis.tables import estimate, interval
from hil.report.markup import table


def coefficients(found: MissingForce) -> str:
    """Each term with its coefficients."""
    rows = [
        (term.form, name, "reading" if term.sensed else "force", estimate(one), interval(one))
        for term in found.form
        for name, one in term.coefficients.items()
    ]
    rows += [(term.form, name, "inside", estimate(one), "") for term in found.form for name, one in term.inside.items()]
    head = ["term", "of", "in the", "coefficient", "95 % interval"]
    caption = "The form of the missing force: coefficients SI per unit mass, with the sign with which they push"
    return table(caption, head, rows, (3, 4)) if rows else ""


def force_terms(found: MissingForce) -> list[str]:
    """A line for each coefficient."""
    lines = []
    for term in found.form:
        inside = "".join(f", {name} = {estimate(one)}" for name, one in term.inside.items())
        lines += [
            f"{_where(term)}{name}: {estimate(one)} · {term.form}{inside}" for name, one in term.coefficients.items()
        ]
    return lines


def _where(term: FormTerm) -> str:
    return "sensed " if term.sensed else "force on "
