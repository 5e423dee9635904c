"""model.h: the functions of models and effects, and what chooses among them by their numbers."""

from collections.abc import Sequence

from estimator.core.generate.effects import ARGUMENTS, FORCE, NAMES, SENSE, effects_of
from estimator.core.generate.model import SIGNATURES, functions
from estimator.core.generate.printer import names_in
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
_OWN = """    if (is_own(effect)) {{
        own_effect(effect)(OWN_{}, {});
        return;
    }}
"""
"""An effect of one's own is called by its address."""


def _chosen(models: Sequence[Model], stem: str, arguments: str, called: str, before: str = "") -> str:
    """The function of a model by its number."""
    cases = "".join(
        f"    case {number}:\n        {model.name}_{called};\n        break;\n" for number, model in enumerate(models)
    )
    head = f"static inline void {stem}({arguments})\n{{\n{before}    switch (model) {{\n"
    return f"{head}{cases}    default:\n        break;\n    }}\n}}"


def _dispatched(models: Sequence[Model], stem: str) -> str:
    signature = SIGNATURES[stem]
    return _chosen(models, stem, f"whole model, {signature}", f"{stem}({names_in(signature)})")


def _effect(models: Sequence[Model], what: str) -> str:
    """The addition of an effect: of the catalogue by its number, of one's own by its address."""
    arguments = f"whole effect, whole model, {ARGUMENTS}"
    own = _OWN.format(what.upper(), NAMES)
    return _chosen(models, f"effect_{what}", arguments, f"effects_{what}(effect, {NAMES})", own)


def generated(models: Sequence[Model], effects: Sequence[Effect], numbers: Sequence[int]) -> str:
    """Text of model.h; `numbers`: which of the effects are in it."""
    parts = ["\n".join(tables())]
    parts += [text for model in models for text in functions(model)]
    parts += [effects_of(model, effects, what, numbers) for what in (FORCE, SENSE) for model in models]
    parts += [_effect(models, what) for what in (FORCE, SENSE)]
    parts += [_dispatched(models, stem) for stem in ("field_columns", "taylor_columns", "sense", "jump")]
    parts += ["#ifdef CORE_FLOAT32", _dispatched(models, "first_term"), "#endif"]
    return "\n\n".join([_HEAD, *parts, "#endif"]) + "\n"
