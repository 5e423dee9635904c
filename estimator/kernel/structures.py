"""What kernels hand to one another, by name: tuples of arrays that the entry kernels build once from what Python gives.

A name costs nothing in compiled code: each entry is a number or an array of its own there, as an argument would be.
"""

from typing import Any, NamedTuple

from estimator.kernel.layout import Floats, Ints, Record

Lanes = Any  # numbers side by side, as `estimator.kernel.lanes` has them


class Arrays(NamedTuple):
    """An observer's own arrays, scaled, as entry kernels take them: live, for whoever calls a kernel with them.

    settings, memory and rows are records (`estimator.kernel.layout`); active (k,) which constants are estimated;
    intensity, prior, spread, initial (k,) as in `Constants`; table (angles, phases, n, axes) the stationary gains; x
    (states + constants,); p, c (n, n) the covariance assumed by the gain and the one that estimates have under it.
    """

    settings: Record
    active: Ints
    intensity: Floats
    prior: Floats
    spread: Floats
    initial: Floats
    table: Floats
    x: Floats
    p: Floats
    c: Floats
    memory: Record
    rows: Record


class Constants(NamedTuple):
    """What is assumed of each constant that is estimated (k,).

    intensity of its random walk, the square of the density: variance per unit of time; prior: variance with which the
    initial value is measured again for what was forgotten of it, 0 for none; spread: its initial variance; initial
    value.
    """

    intensity: Floats
    prior: Floats
    spread: Floats
    initial: Floats


class Estimate(NamedTuple):
    """What a filter carries from sample to sample.

    x (states + constants,); p the covariance that the gain assumes, c the one that the estimates have under it; memory
    (`estimator.kernel.layout.MEMORY`).
    """

    x: Floats
    p: Floats
    c: Floats
    memory: Record


class Sample(NamedTuple):
    """z (axes,) what was measured, NaN where nothing was; u (axes, degree + 1) the drive over the interval of length h
    that ends there.
    """

    z: Floats
    u: Floats
    h: float


class Interval(NamedTuple):
    """A stretch of time: where it begins, its length, and the drive u (axes, degree + 1) in it as a polynomial in
    normalised time.
    """

    time: float
    h: float
    u: Floats


class Push(NamedTuple):
    """Sum of the effects' forces (axes,) with its derivatives by_states (axes, states) and by_constants (axes,
    constants); what they depend on: drive (axes,) and signals (2 MAX_SIGNALS,), values and derivatives by the velocity.

    slips (MAX_SLIPS, columns): signals that depend on the way, in the columns of the flow; their place in the second
    half of signals has the derivative of the force by them.
    """

    force: Floats
    by_states: Floats
    by_constants: Floats
    drive: Floats
    signals: Floats
    slips: Floats


class FlowWork(NamedTuple):
    """Result and scratch of a flow.

    out, columns [state | ∂/∂s0 | ∂/∂flow and effect constants] (states, columns) of what is advanced; term of the
    Taylor series and other, of its shape, and state (states,) are scratch; push what the effects do.  Of two axes:
    powers (orders, 16), the terms of exp(M h); drifts (4, 80) as `estimator.kernel.drifts.drift_matrices` leaves them;
    entries (4, 8), what a unit of each state added to the force of each axis does to the states.
    """

    term: Floats
    other: Floats
    out: Floats
    push: Push
    state: Floats
    powers: Floats
    drifts: Floats
    entries: Floats


class Workspace(NamedTuple):
    """Scratch of one observer of n states and active constants, m with all constants, made once per block.

    transition (n, states) the states' rows of the Jacobian, turned; rows (2 · states, n) and projected (4, n) of
    covariances, filled up; jacobian (2, n) of the measurement, full (2, m) by all constants; gain (n, 2); jump
    (states,) what a constant's jump does; before (states,) the state before the interval; per axis: predicted
    measurement, its noise, the noise that the gain assumes, innovation and its variance.
    """

    flow: FlowWork
    transition: Floats
    rows: Floats
    projected: Floats
    jacobian: Floats
    full: Floats
    gain: Floats
    jump: Floats
    before: Floats
    predicted: Floats
    noise: Floats
    assumed: Floats
    innovation: Floats
    variance: Floats


class Projected(NamedTuple):
    """What one measurement h shows of a filter in lanes (`estimator.kernel.lanes`).

    Of the assumed covariance P the product P h, by states and by constants, and the variance h'Ph + R; the same of the
    actual one, C; its covariance with the angle.
    """

    states: Lanes
    constants: Lanes
    variance: float
    actual_states: Lanes
    actual_constants: Lanes
    actual_variance: float
    with_angle: float
