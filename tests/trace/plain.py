"""An extended Kalman filter of a vibrating gyro in SI, by NumPy and SciPy alone: what the passes are compared with.

Columns of parameters are followed side by side.  The first has the gain; the others are corrected with that same gain,
so that their differences are the sensitivities of the innovations with the gain held.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from estimator.record import Record
from estimator.settings import Device, Gain, ObserverSettings, ProcessNoise, Spread
from estimator.trace.problem import Problem

Array = NDArray[np.float64]
Columns = Mapping[str, Array]
"""Parameters by name, each (m,)."""

OMEGA0 = 2 * np.pi * 200.0
RATE = 4000.0
AMPLITUDE = 1e-4
GAIN = np.array([-890.0, -930.0])
NOISE = np.array([9e-5, 12e-5])
BASE = {
    "kxx": 1.02 * OMEGA0**2, "kyy": 0.98 * OMEGA0**2, "kxy": 0.01 * OMEGA0**2, "dxx": 12.0, "dyy": 9.0, "dxy": 1.5,
}  # fmt: skip
ALONE = {"kxx": 1.02 * OMEGA0**2, "dxx": 12.0, "drive_gain_x": 1.1}


def nothing(s: Array, u: Array, t: float, warmth: float, p: Columns) -> tuple[Array | float, ...]:
    """No effect."""
    return 0.0, 0.0


@dataclass(frozen=True)
class Plain:
    """What is assumed: standard deviations at the start (states, offsets and the rate), of the noise; effects.

    force, sense: of state (2 axes, m), drive (axes,), time, temperature and parameters: acceleration and displacement
    by axis; substeps: of the Runge-Kutta rule, 0 for the matrix exponential of the linear model.
    """

    axes: int
    spread: Array
    motion: Array
    noise: Array
    force_noise: float = 0.0
    rate_walk: float = 0.0
    force: Callable[..., tuple[Array | float, ...]] = nothing
    sense: Callable[..., tuple[Array | float, ...]] = nothing
    substeps: int = 0
    unsettled: Mapping[int, Array] = field(default_factory=dict)

    def slope(self, s: Array, u: Array, t: float, warmth: float, p: Columns) -> Array:
        """Derivative by time of the states (2 axes, m)."""
        pushed = self.force(s, u, t, warmth, p)
        if self.axes == 1:
            x, vx = s
            return np.array([vx, -p["kxx"] * x - p["dxx"] * vx + p["drive_gain_x"] * u[0] + pushed[0]])
        x, vx, y, vy = s
        w = p["rate"]
        ax = -p["kxx"] * x - p["kxy"] * y - p["dxx"] * vx - p["dxy"] * vy + 2 * w * vy + w**2 * x + u[0] + pushed[0]
        ay = -p["kxy"] * x - p["kyy"] * y - p["dxy"] * vx - p["dyy"] * vy - 2 * w * vx + w**2 * y + u[1] + pushed[1]
        return np.array([vx, ax, vy, ay])

    def generator(self, p: Columns) -> Array:
        """(m, 3 axes, 3 axes): of states and held drive."""
        m, n = len(p["kxx"]), 2 * self.axes
        a = np.zeros((m, n + self.axes, n + self.axes))
        for j in range(n + self.axes):
            unit = np.zeros((n + self.axes, m))
            unit[j] = 1.0
            a[:, :n, j] = self.slope(unit[:n], unit[n:, 0], 0.0, 0.0, p).T
        return a

    def over(self, s: Array, u: Array, length: Array | float, p: Columns) -> Array:
        """The linear model over a time of its own in each column."""
        scaled = self.generator(p) * np.reshape(np.broadcast_to(length, (s.shape[1],)), (-1, 1, 1))
        whole = np.vstack([s, np.tile(np.asarray(u)[:, None], s.shape[1])])
        return np.asarray(np.einsum("mij,jm->im", expm(scaled), whole)[: len(s)])

    def flow(self, s: Array, drives: tuple[Array, Array], t: float, h: float, warmth: float, p: Columns) -> Array:
        """The states an interval later; drives: of the one before, and of this one, which is late by `tux`, `tuy`."""
        before, u = drives
        if self.substeps == 0:
            if "tux" not in p:
                return self.over(s, u, h, p)
            free, rest = self.over(s, 0 * u, h, p), np.zeros_like(s)
            for axis, name in enumerate(("tux", "tuy")[: self.axes]):
                one = np.eye(self.axes)[axis]
                begun, ended = self.over(0 * s, one, h - p[name], p), self.over(0 * s, one, h, p)
                rest = rest + begun * u[axis] + (ended - begun) * before[axis]
            return np.asarray(free + rest)
        step = h / self.substeps
        for k in range(self.substeps):
            at = t + k * step
            a = self.slope(s, u, at, warmth, p)
            b = self.slope(s + step / 2 * a, u, at + step / 2, warmth, p)
            c = self.slope(s + step / 2 * b, u, at + step / 2, warmth, p)
            d = self.slope(s + step * c, u, at + step, warmth, p)
            s = s + step / 6 * (a + 2 * b + 2 * c + d)
        return s

    def shown(self, x: Array, u: Array, t: float, warmth: float, p: Columns) -> Array:
        """The channels (axes, m), V, of states and offsets."""
        s = x[: 2 * self.axes]
        seen = s
        if "tsx" in p:
            seen = np.vstack([self.over(s, u, -p[name], p)[2 * k : 2 * k + 2] for k, name in enumerate(("tsx", "tsy"))])
        added = self.sense(s, u, t, warmth, p)
        return np.array(
            [GAIN[a] * (seen[2 * a] + added[a]) + x[2 * self.axes + a] for a in range(self.axes)]
        )  # fmt: skip

    def split(self, x: Array, p: Columns) -> tuple[Array, Columns]:
        """States and parameters with the rate, which is a state of the filter."""
        return x[: 2 * self.axes], ({**p, "rate": x[-1]} if self.axes == 2 else p)

    def follow(self, z: Array, u: Array, h: Array, p: Columns, warmth: Array | None = None) -> tuple[Array, Array]:
        """Innovations (n, axes, m), NaN where nothing was measured, and the covariance (n, axes, axes) of the first."""
        m, axes, n = len(p["kxx"]), self.axes, 2 * self.axes
        size = 3 * axes + (axes == 2)
        x = np.zeros((size, m))
        x[:n] = self.motion[:, None]
        cov = np.diag(self.spread**2)
        warm = np.zeros(len(z)) if warmth is None else warmth - warmth[0]
        shifts = np.concatenate([np.eye(size), -np.eye(size)]).T * 1e-3 * self.steps[:, None]
        own = {name: np.full(2 * size, value[0]) for name, value in p.items()}
        both = {name: np.concatenate([value, own[name]]) for name, value in p.items()}
        innovations, covariances, t, before = (
            np.full((len(z), axes, m), np.nan),
            np.zeros((len(z), axes, axes)),
            0.0,
            0 * u[0],
        )
        for k in range(len(z)):
            wide = np.hstack([x, x[:, :1] + shifts])
            s, q = self.split(wide, both)
            wide[:n] = self.flow(s, (before, u[k]), t, h[k], warm[k], q)
            t, before = t + h[k], u[k]
            x = wide[:, :m]
            jacobian = self.slopes(wide[:, m:])
            cov = jacobian @ cov @ jacobian.T + self.process(x[:, 0], h[k])
            around = x[:, :1] + shifts
            seen = self.shown(np.hstack([x, around]), u[k], t, warm[k], self.split(np.hstack([x, around]), both)[1])
            told = np.isfinite(z[k])
            slope = np.where(told[:, None], self.slopes(seen[:, m:]), 0.0)
            covariances[k] = slope @ cov @ slope.T + np.diag(self.noise[:axes] ** 2)
            nu = np.where(told[:, None], z[k][:, None] - seen[:, :m], 0.0)
            innovations[k, told] = nu[told]
            gain = cov @ slope.T @ np.linalg.inv(covariances[k])
            x = x + gain @ nu
            left = np.eye(size) - gain @ slope
            cov = left @ cov @ left.T + gain @ np.diag(self.noise[:axes] ** 2) @ gain.T
            if k in self.unsettled:
                cov = self.unsettle(cov, self.unsettled[k])
        return innovations, covariances

    @property
    def steps(self) -> Array:
        """Of the differences that are taken, in the units of states, offsets and rate."""
        motion = [AMPLITUDE, AMPLITUDE * OMEGA0] * self.axes
        return np.array([*motion, *[0.1] * self.axes, *([100.0] if self.axes == 2 else [])])

    def slopes(self, values: Array) -> Array:
        """By states, offsets and rate, of values at points to either side."""
        size = values.shape[1] // 2
        return np.asarray((values[:, :size] - values[:, size:]) / (2e-3 * self.steps))

    def process(self, x: Array, h: float) -> Array:
        """Covariance that an interval adds: a white force on a free mass, a walk of the rate with Euler's impulse."""
        size, added = len(x), np.zeros((len(x), len(x)))
        for axis in range(self.axes):
            at = slice(2 * axis, 2 * axis + 2)
            added[at, at] = self.force_noise**2 / 2.0 * np.array([[h**3 / 3, h**2 / 2], [h**2 / 2, h]])
        if self.axes == 2:
            jump = np.zeros(size)
            jump[[1, 3, 6]] = x[2], -x[0], 1.0
            added += self.rate_walk**2 * h * np.outer(jump, jump)
        return added

    def unsettle(self, cov: Array, spread: Array) -> Array:
        """Behind a gap: more of the motion is uncertain; all of it, where that is infinite."""
        n = 2 * self.axes
        if np.all(np.isfinite(spread)):
            cov[:n, :n] += spread
            return cov
        cov[:n] = 0.0
        cov[:, :n] = 0.0
        cov[:n, :n] = np.diag(self.spread[:n] ** 2)
        return cov


def simulated(
    n: int, p: Mapping[str, float], *, axes: int = 2, seed: int = 0, noise: Array = NOISE, step: Array | None = None,
    force: Callable[..., tuple[Array | float, ...]] = nothing, rate: float = 0.3, substeps: int = 0, size: float = 1.0,
) -> tuple[Array, Array, Array, Array]:  # fmt: skip
    """A made record: sense (n, axes) V, held drive (n, axes), steps (n,), and the motion (2 axes,) that it began with.

    The drive holds the amplitude about, in quadrature to itself, with as much noise beside.
    """
    rng = np.random.default_rng(seed)
    h = np.full(n, 1 / RATE) if step is None else step
    world = Plain(axes, np.zeros(0), np.zeros(0), noise, force=force, substeps=substeps)
    one = {name: np.array([value]) for name, value in p.items()} | {"rate": np.array([rate])}
    begun = size * AMPLITUDE * np.array([0.9, 0.1 * OMEGA0, 0.3, -0.5 * OMEGA0])[: 2 * axes]
    s, t, before = begun[:, None], 0.0, np.zeros(axes)
    sense, drive = np.zeros((n, axes)), np.zeros((n, axes))
    for k in range(n):
        strength = AMPLITUDE * OMEGA0 * 12.0
        drive[k] = size * strength * (s[1::2, 0] / (AMPLITUDE * OMEGA0) + 2.0 * rng.standard_normal(axes))
        s = world.flow(s, (before, drive[k]), t, h[k], 0.0, one)
        t, before = t + h[k], drive[k]
        sense[k] = GAIN[:axes] * s[::2, 0] + 0.02 + noise[:axes] * rng.standard_normal(axes)
    return sense, drive, h, begun


WHITE = 3e-4  # m/s² per √Hz


def records(draws: int, n: int = 1500, late: float = 0.0) -> tuple[Array, Array]:
    """Sense (draws, n, 2) V and held drive (draws, n, 2) of a linear gyro that turns at 0.3 rad/s under a white force,
    sensed so many s late.
    """
    rng = np.random.default_rng(17)
    p = {name: np.array([value]) for name, value in BASE.items()} | {"rate": np.array([0.3])}
    generator = Plain(2, np.zeros(0), np.zeros(0), NOISE).generator(p)[0]
    whole, back = expm(generator / RATE), expm(-generator * late)
    s = np.tile(AMPLITUDE * np.array([0.9, 0.1 * OMEGA0, 0.3, -0.5 * OMEGA0])[:, None], draws)
    sense, drive = np.zeros((draws, n, 2)), np.zeros((draws, n, 2))
    for k in range(n):
        u = 12.0 * (s[1::2] + 2.0 * AMPLITUDE * OMEGA0 * rng.standard_normal((2, draws)))
        s = whole[:4, :4] @ s + whole[:4, 4:] @ u
        seen = back[:4, :4] @ s + back[:4, 4:] @ u
        s[1::2] += WHITE / np.sqrt(2.0 * RATE) * rng.standard_normal((2, draws))
        drive[:, k] = u.T
        sense[:, k] = (GAIN[:, None] * seen[::2] + NOISE[:, None] * rng.standard_normal((2, draws))).T + np.array(
            [0.004, -0.003]
        )
    return sense, drive


def problem(sense: Array, drive: Array, off: float = 1.0) -> Problem:
    """Of such a record, the stiffness of one axis declared that much too large, and of the other too small."""
    values = [off * BASE["kxx"], BASE["kyy"] / off, BASE["kxy"], BASE["dxx"], BASE["dyy"], BASE["dxy"]]
    device = Device(
        RATE, tuple(values[:3]), tuple(values[3:]), AMPLITUDE, tuple(GAIN), tuple(NOISE), target_stiffness=OMEGA0**2
    )
    settings = ObserverSettings(
        gain=Gain.EKF, spread=Spread(offset=0.02, rate=1.0, stiffness=0.05, damping=2.0),
        process_noise=ProcessNoise(force=WHITE, rate=0.05),
    )  # fmt: skip
    return Problem(Record(sense, drive[:, :, None], np.full(len(sense), 1 / RATE)), device, settings)
