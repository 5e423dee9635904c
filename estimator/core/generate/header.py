"""model.h: the functions of models and effects, and what chooses among them by their numbers."""

from collections.abc import Sequence

from estimator.core.generate.effects import ARGUMENTS, FORCE, NAMES, SENSE, effects_of
from estimator.core.generate.model import functions
from estimator.core.generate.series import tables
from estimator.effects.declaration import Effect
from estimator.model.declaration import Model

_HEAD = """/* Written from the declarations of models and effects; not to be edited. */
#ifndef GYRO_MODEL_H
#define GYRO_MODEL_H

#include "lanes.h"
#include "layout.h"
#include "own.h"
#include "structs.h"
"""
_DISPATCHED = {
    "field_columns": (
        "const real *c, const real *a, const real *u, real *out, whole columns, whole stride",
        "c, a, u, out, columns, stride",
    ),
    "taylor_columns": (
        "const real *c, const real *u, whole terms, real h, whole order, whole columns, real *a, real *out,\n"
        "    whole stride",
        "c, u, terms, h, order, columns, a, out, stride",
    ),
    "sense": ("const real *c, const real *s, real *z, real *jacobian, whole stride", "c, s, z, jacobian, stride"),
    "jump": ("const real *s, whole constant, real *out", "s, constant, out"),
}
_IN_32_BITS = {
    "first_term": (
        "const real *c, const real *s, const real *rest, const real *u, whole terms, real h,\n    double *out",
        "c, s, rest, u, terms, h, out",
    ),
}
_STEMS = {"taylor_columns": "taylor"}


def _chosen(models: Sequence[Model], stem: str, arguments: str, names: str) -> str:
    """The function of a model by its number."""
    lines = [f"static inline void {stem}(whole model, {arguments})", "{", "    switch (model) {"]
    for number, model in enumerate(models):
        lines += [f"    case {number}:", f"        {model.name}_{_STEMS.get(stem, stem)}({names});", "        break;"]
    return "\n".join([*lines, "    default:", "        break;", "    }", "}"])


def _effect(models: Sequence[Model], what: str) -> str:
    """The addition of an effect: of the catalogue by its number, of one's own by its address."""
    lines = [
        f"static inline void effect_{what}(whole effect, whole model, {ARGUMENTS})",
        "{",
        "    if (is_own(effect)) {",
        f"        own_effect(effect)(OWN_{what.upper()}, {NAMES});",
        "        return;",
        "    }",
        "    switch (model) {",
    ]
    for number, model in enumerate(models):
        lines += [f"    case {number}:", f"        {model.name}_effects_{what}(effect, {NAMES});", "        break;"]
    return "\n".join([*lines, "    default:", "        break;", "    }", "}"])


def generated(models: Sequence[Model], effects: Sequence[Effect], numbers: Sequence[int]) -> str:
    """Text of model.h; `numbers`: which of the effects are in it."""
    parts = ["\n".join(tables())]
    parts += [text for model in models for text in functions(model)]
    parts += [effects_of(model, effects, what, numbers) for what in (FORCE, SENSE) for model in models]
    parts += [_effect(models, what) for what in (FORCE, SENSE)]
    parts += [_chosen(models, stem, arguments, names) for stem, (arguments, names) in _DISPATCHED.items()]
    parts += ["#ifdef CORE_FLOAT32"]
    parts += [_chosen(models, stem, arguments, names) for stem, (arguments, names) in _IN_32_BITS.items()]
    parts += ["#endif"]
    return "\n\n".join([_HEAD, *parts, "#endif"]) + "\n"
