"""A term of a form as text, in the grammar of [effects.custom]: what one of each coefficient adds to the axes, in SI.

Where a term turns over with the velocity it is written as `sign(vx)`, which turns over as tanh(v/v_rest) does and at
which the flow of an observer stops: a tanh is asked at a few instants of a step, between which the velocity runs
through it.

A term is homogeneous: the text that holds in scaled units holds in SI, too, with the number inside it as a parameter.
"""

import re

import sympy as sp

from estimator.missing_force.library import THRESHOLD, Term, temperature, vx, vy

_NAMES = {"Abs": "abs", "temperature": "T"}
_WORD = re.compile(r"[A-Za-z_][A-Za-z_0-9]*")


def laws(term: Term) -> dict[str, tuple[str, str]]:
    """By label of the coefficient, the laws along x and y, "" where there is none.

    `sign(vx)` and `sign(vy)` stand for the tanh of the velocity over the number inside the term.  Empty for a term that
    is no function of the moment, as hysteresis: that grammar has no memory.
    """
    if term.series is not None:
        return {}
    columns = term.columns
    if term.threshold is not None:
        inside = sp.Symbol(term.threshold[0], positive=True)
        turned = [(sp.tanh(speed / THRESHOLD), sp.Function("sign")(sp.Symbol(speed.name))) for speed in (vx, vy)]
        columns = tuple(
            (one.subs(turned).subs(THRESHOLD, inside), two.subs(turned).subs(THRESHOLD, inside))
            for one, two in term.general
        )
    return {label: (_text(one), _text(two)) for label, (one, two) in zip(term.labels, columns, strict=True)}


def _text(law: sp.Expr) -> str:
    if law == 0:
        return ""
    return _WORD.sub(lambda word: _NAMES.get(word[0], word[0]), sp.sstr(law.subs(temperature, sp.Symbol("T"))))
