"""The noise of a record by maximum likelihood, the parameters of its model being as they are."""

from dataclasses import replace

import numpy as np

from estimator.identification.likelihood import Layout, Model, Noise, evaluate
from estimator.trace.problem import Problem

STEP = 2.0
"""Decades between the values first tried: the likelihood has one top, a few decades wide."""
DECADES = 8.0
"""Above what is declared that a random force may be: at the top, a filter follows whatever moves."""
CLOSE = 0.5
"""Decades to which a level is found: the likelihood of any parameter is flat beside that."""


def fit_noise(problem: Problem, layout: Layout, model: Model) -> Model:
    """The model with levels of noise that make the record most probable: sense by axis, random force, rate.

    A model that lacks something has a random force in its place, as large as what it leaves.
    """
    model = _best(problem, layout, _balanced(problem, layout, model), "force", CLOSE)
    return _best(problem, layout, model, "rate", CLOSE)


def quieten(problem: Problem, layout: Layout, model: Model) -> Model:
    """The model with about the random force that makes the record most probable."""
    return _best(problem, layout, model, "force", STEP / 2.0)


def declared_noise(problem: Problem) -> Noise:
    """What the bench declares; where it declares no random force or rate, a level that is none."""
    process, device = problem.settings.process_noise, problem.device
    omega = float(np.sqrt(device.target))
    quiet = 1e-9 * device.amplitude * omega**1.5
    return Noise((1.0,) * device.axes, max(process.force, quiet), max(process.rate, 1e-9 * omega**1.5))


def _balanced(problem: Problem, layout: Layout, model: Model) -> Model:
    """With the sense noise of each axis as its innovations have it beside the others'."""
    seen = evaluate(problem, layout, model, derivatives=False)
    with np.errstate(invalid="ignore"):
        power = np.nanmedian((seen.innovation / seen.deviation) ** 2, axis=0) / 0.455
    if not np.all(np.isfinite(power)) or not np.all(power > 0.0):
        return model
    share = np.sqrt(power / np.exp(np.mean(np.log(power))))
    return replace(model, noise=replace(model.noise, sense=tuple(np.array(model.noise.sense) * share)))


def _best(problem: Problem, layout: Layout, model: Model, which: str, close: float) -> Model:
    """With the level of that noise which has the largest likelihood, found to so many decades."""
    least = np.log10(getattr(declared_noise(problem), which))

    def tried(level: float) -> tuple[float, Model]:
        changed = replace(model, noise=replace(model.noise, **{which: float(10.0**level)}))
        return evaluate(problem, layout, changed, derivatives=False).log_likelihood, changed

    if which == "rate" and problem.device.axes == 1:
        return model
    now = np.log10(getattr(model.noise, which))
    low, high = least - (0.0 if which == "force" else 3.0), least + (DECADES if which == "force" else 2.0)
    known = {now: tried(now)}
    step = STEP
    at = now
    while step >= close:
        for level in (at - step, at + step):
            level = min(max(level, low), high)
            if level not in known:
                known[level] = tried(level)
        best = max(known, key=lambda level: known[level][0])
        if best == at:
            step /= 2.0
        at = best
    return known[at][1]
