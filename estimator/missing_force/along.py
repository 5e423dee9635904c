"""What the terms of a form do along a motion that is known: the force, and what is sensed beside the displacement.

Of terms that depend on the past a delay alone is known from the motion at hand; others count for nothing here.
"""

from collections.abc import Mapping

import numpy as np

from estimator.effects.declaration import Coefficient, Delayed, Effect, Parameter, Signal, Source, name_of
from estimator.scaling import Array, Scaling

_OF_THE_PAST = (Source.INTEGRAL, Source.RESONATOR, Source.LAG, Source.SLIP, Source.STOP)


def along(
    effect: Effect, given: Mapping[str, float], scaling: Scaling, series: Mapping[str, Array], axes: int
) -> tuple[Array, Array]:
    """Force and sensed displacement (n, axes), scaled, of an effect with its numbers `given` (SI); series (n,) by name:
    time t, temperature T, motion and drive of each axis.
    """
    n = len(series["t"])
    nothing = np.zeros((n, axes))
    numbers = {name_of(one): one.default or 0.0 for one in effect.parameters}
    own: tuple[Coefficient | Parameter, ...] = (*effect.coefficients, *effect.parameters)
    for one in own:
        if (name := one.name.partition(":")[0]) in given:
            numbers[name_of(one)] = given[name] / scaling.coefficient(one)
    if effect.delayed is not None:
        late = np.array([numbers[name_of(one)] for one in effect.coefficients])
        if effect.delayed is Delayed.SENSE:
            return nothing, -late * np.stack([series[f"v{axis}"] for axis in "xy"[:axes]], axis=1)
        slopes = [np.gradient(series[f"u{axis}"], series["t"]) for axis in "xy"[:axes]]
        return -late * np.stack(slopes, axis=1), nothing
    if any(signal.source in _OF_THE_PAST for signal in effect.signals):
        return nothing, nothing
    values: dict[str, Array | float] = {**series, **numbers}
    for signal in (one for one in effect.signals if one.axis < axes):
        values[name_of(signal)] = _signal(effect, signal, numbers, series)
    return _evaluated(effect, "force", values, n, axes), _evaluated(effect, "sense", values, n, axes)


def _signal(effect: Effect, signal: Signal, numbers: Mapping[str, float], series: Mapping[str, Array]) -> Array | float:
    first = numbers[name_of(effect.parameters[0])] if effect.parameters else 0.0
    behind, t = numbers.get(name_of(signal, "behind"), 0.0), series["t"]
    match signal.source:
        case Source.PARAMETER:
            return numbers[name_of(signal)]
        case Source.COSINE:
            return np.cos(first * t)
        case Source.SINE:
            return np.sin(first * t)
        case Source.TEMPERATURE:
            return series["T"]
        case Source.DIRECTION:
            return np.tanh(series["v" + "xy"[signal.axis]] / first)
        case Source.DECAY:
            return np.exp(-numbers[name_of(effect.parameters[signal.axis])] * t)
        case Source.WANE:
            return np.exp(-t / behind)
    return t


def _evaluated(effect: Effect, which: str, values: Mapping[str, Array | float], n: int, axes: int) -> Array:
    import sympy as sp

    out = np.zeros((n, axes))
    for axis, expression in enumerate(getattr(effect, which)[:axes]):
        names = sorted(str(symbol) for symbol in expression.free_symbols)
        plain = expression.subs({symbol: sp.Symbol(symbol.name) for symbol in expression.free_symbols})
        out[:, axis] = sp.lambdify([sp.Symbol(name) for name in names], plain, "numpy")(*(values[k] for k in names))
    return out
