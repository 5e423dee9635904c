"""The observer as a textbook writes it: dense F, dense P, one line per equation, in plain NumPy."""

import math
from collections.abc import Callable

import numpy as np

from estimator.errors import ModelError
from estimator.observer import Estimates, Observer
from estimator.oracle.evaluation import evaluated
from estimator.oracle.flow import flow
from estimator.oracle.pattern import PatternAngle, pattern, pattern_gradient
from estimator.scaling import Array
from estimator.settings import ControllerSettings, Device, Gain, ObserverSettings, Sensed, Variant

HASTY_NIS, ATTENTION, FASTEST = 3.0, 0.05, 0.1


class NumpyObserver(Observer):
    """`estimator.observer.Observer` for replay, some hundred times slower and independent of the kernels.

    Raises ModelError like the observer, and for `tick`: an oracle closes no loop.
    """

    backend = "numpy"

    def __init__(
        self, device: Device, settings: ObserverSettings, controller: ControllerSettings | None = None
    ) -> None:
        super().__init__(device, settings, controller)
        if self.effects:
            raise ModelError(f"backend '{self.backend}' runs the base model; take [effects] out or use backend 'c'")
        if any(sensed is not Sensed.DISPLACEMENT for sensed in device.sensed):
            raise ModelError(f"backend '{self.backend}' senses displacement; use backend 'c'")
        self._model = evaluated(self.number)
        self._fading = settings.gain is not Gain.EKF
        self._fade = math.exp(1.0 / (settings.memory * device.sample_rate)) if self._fading else 1.0
        volts = [self.scaling.sense(axis) for axis in range(device.axes)]
        self._noise = np.diag((np.array(device.noise) / volts) ** 2)
        ignored = settings.spread.offset if settings.variant is Variant.GYRO else 0.0
        self._assumed = self._noise + np.diag((ignored / np.array(volts)) ** 2)
        self._carries_both = self._fading or ignored > 0.0
        force = settings.process_noise.force**2 / 2.0 / (device.amplitude**2 * self.scaling.omega0**3)
        self._force = np.full(device.axes, force)
        self._virtual = 0.0 if controller is None else controller.virtual_rotation / self.scaling.omega0
        self._reversal = 0.0 if controller is None else controller.virtual_reversal * self.scaling.omega0
        self._time = 0.0
        self._nis = 1.0
        self._cursor = 0
        self._theta, self._theta_plain = PatternAngle(), PatternAngle()
        self._turned = np.zeros(3)  # ∫Ω̂ dt, ∫Ωv dt and the rotation of the pattern by forces, so far
        self._angle_cross, self._angle_variance = np.zeros(len(self.estimated_index)), 0.0
        self._gradient = np.zeros(len(self.estimated_index))
        self._referred = False
        self._frame: tuple[float, float] | None = None  # Ω̂ + Ωv and Ω̂ of the newest sample

    def tick(self, vx: float, vy: float, ux: float, uy: float) -> tuple[int, int]:
        """Raises ModelError: an oracle closes no loop."""
        raise ModelError(f"backend '{self.backend}' only replays records; close the loop with backend 'c'")

    def run(
        self,
        sense: Array,
        drive: Array,
        *,
        step: Array | None = None,
        every: int = 1,
        temperature: Array | None = None,
        truth: Array | None = None,
    ) -> Estimates:
        """As `Observer.run`."""
        self._require_rows(len(sense), drive=drive, step=step, truth=truth)
        n, axes = len(sense), self.device.axes
        volts = np.array([self.scaling.sense(axis) for axis in range(axes)])
        z = np.asarray(sense, dtype=float) / volts
        u = np.asarray(drive, dtype=float).reshape(n, axes, -1) / self.scaling.drive
        h = np.full(n, self.h) if step is None else np.asarray(step, dtype=float) * self.scaling.omega0
        states = np.zeros((n, len(self.x)))
        predicted, deviations = np.zeros_like(states), np.zeros_like(states)
        innovation, variance = np.zeros((n, axes)), np.zeros((n, axes))
        angle_variance, virtual = np.zeros(n), self._imposed(u, self._time + np.cumsum(h) - h)
        frame = self._frame or (0.0, 0.0)
        for m in range(n):
            if truth is not None:
                self.x[:] = truth[m] / self.factors
            self._predict_over(u[m], float(h[m]), frame)
            predicted[m] = self.x
            innovation[m], variance[m] = self._correct_with(z[m])
            self._time += h[m]
            if not self._referred and self._time >= self.settings.reference * self.scaling.omega0:
                self._referred, self._angle_variance = True, 0.0
                self._angle_cross[:] = 0.0
            angle_variance[m] = self._angle_variance
            states[m] = self.x
            if axes == 2:
                rate = self.x[self.model.names.index("rate")]
                frame = (rate + virtual[m], rate)
            deviations[m, self.estimated_index] = np.sqrt(np.diag(self._c if self._carries_both else self._p))
        index = np.arange(every - 1, n, every)
        angles = self._angles(predicted, states, virtual, h) if axes == 2 else np.zeros((7, n))
        return Estimates(
            self.model.names, index, states[index] * self.factors, deviations[index] * np.abs(self.factors),
            innovation * volts, np.sqrt(variance) * np.abs(volts),
            angles[0], np.sqrt(angle_variance) / self.device.angular_gain, *angles[1:],
        )  # fmt: skip

    def _carry_angle(self) -> None:
        """Not done: the angles of a run are computed behind it."""

    # -- one sample --------------------------------------------------------------------------------------------------

    def _predict_over(self, u: Array, h: float, frame: tuple[float, float]) -> None:
        """Advance x, P and C over h under the drive polynomial u (axes, degree + 1); the pattern was read at the
        rotation and the rate of `frame` last.
        """
        s, transition, sensitivity = flow(self._model, self.x[self.states :], self.x[: self.states], u, h)
        sensing = len(self.model.sense_constants)
        flowing = self.active >= sensing
        f = np.eye(len(self.estimated_index))
        f[: self.states, : self.states] = transition
        f[: self.states, self.states :][:, flowing] = sensitivity[:, self.active[flowing] - sensing]
        q = self._process_noise(s, h)
        if self.device.axes == 2:  # the angle as one more state that Ω moves: φ̃ + Ω̃ h
            actual = self._c
            rate = list(self.estimated_index).index(self.model.names.index("rate"))
            turned = np.vstack([np.eye(len(actual)), h * np.eye(len(actual))[rate]])
            joint = turned @ actual @ turned.T
            joint[-1, :-1] += self._angle_cross
            joint[-1, -1] += self._angle_variance + 2.0 * h * self._angle_cross[rate]
            self._angle_cross, self._angle_variance = f @ joint[-1, :-1], float(joint[-1, -1])
        self._c[:] = f @ self._c @ f.T + q
        self._predict(s, f, q)
        if self.device.axes == 2 and s.any() and not self.settings.open_loop:  # a mass at rest has no angle
            self._gradient[[0, 1, 2, 3, rate]] = pattern_gradient(s, 1.0, *frame)

    def _correct_with(self, z: Array) -> tuple[Array, Array]:
        """Update with z (axes,), NaN where lost; innovation (0 there) and its predicted variance."""
        seen = np.isfinite(z)
        jacobian = self._model.jacobian(self.x[: self.states], self.x[self.states :])[:, self.estimated_index]
        innovation = np.where(seen, z - self._measure(self.x), 0.0)
        actual = self._c if self._carries_both else self._p
        predicted = jacobian @ actual @ jacobian.T
        variance = np.diag(self._noise) + np.where(seen, np.diag(predicted), 0.0)
        if not seen.any():
            return innovation, variance
        h_seen, r_seen = jacobian[seen], self._noise[np.ix_(seen, seen)]
        assumed = self._assumed[np.ix_(seen, seen)]
        if not self._propagates:
            self._correct(self._tabulated_gain()[:, seen], h_seen, r_seen, innovation[seen])
            return innovation, variance
        s_seen = h_seen @ self._p @ h_seen.T + assumed
        nis = float(innovation[seen] @ np.linalg.solve(s_seen, innovation[seen])) / len(z)
        self._nis += ATTENTION * (nis - self._nis)
        self._update(z[seen], lambda x: self._measure(x)[seen], h_seen, assumed, r_seen)
        if self._fading:
            self._remember_prior()
        return innovation, variance

    def _measure(self, x: Array) -> Array:
        return self._model.measurement(x[: self.states], x[self.states :])

    @property
    def _propagates(self) -> bool:
        """Whether the gain comes from P: always, but for a stationary gain once it has taken over."""
        acquiring = self._time < self.settings.takeover * self.scaling.omega0
        return self.settings.gain is not Gain.STATIONARY or acquiring

    def _predict(self, s: Array, f: Array, q: Array) -> None:
        """x ← the flow, P ← fade · F P Fᵀ + Q."""
        self.x[: self.states] = s
        if self._propagates:
            self._p[:] = self._fading_factor() * (f @ self._p @ f.T) + q

    def _update(self, z: Array, measure: Callable[[Array], Array], h: Array, assumed: Array, declared: Array) -> None:
        """Kalman update of x and P with a measurement z = measure(x) + noise of covariance `assumed`, and of C by the
        same gain with the noise declared.
        """
        gain = np.asarray(np.linalg.solve(h @ self._p @ h.T + assumed, h @ self._p).T, dtype=float)
        self._p[:] = _joseph(self._p, gain, h, assumed)
        self._correct(gain, h, declared, z - measure(self.x))

    def _correct(self, gain: Array, h: Array, r: Array, innovation: Array) -> None:
        if self.device.axes == 2:
            self._correct_angle(gain, h, r)
        self.x[self.estimated_index] += gain @ innovation
        self._c[:] = _joseph(self._c, gain, h, r)

    def _correct_angle(self, gain: Array, h: Array, r: Array) -> None:
        """Joseph's form over states, constants and angle, whose gain is what the correction turns the pattern by."""
        n = len(gain)
        joint = np.block(
            [[self._c, self._angle_cross[:, None]], [self._angle_cross[None, :], np.array([[self._angle_variance]])]]
        )
        longer = np.vstack([gain, -self._gradient @ gain])
        joint = _joseph(joint, longer, np.hstack([h, np.zeros((len(h), 1))]), r)
        self._angle_cross, self._angle_variance = joint[n, :n], float(joint[n, n])

    def _process_noise(self, s: Array, h: float) -> Array:
        """Q over one step: integrated force noise, and random walks with what their jumps do to the states s."""
        q = np.zeros((len(self.estimated_index),) * 2)
        integrated = np.array([[h**3 / 3.0, h**2 / 2.0], [h**2 / 2.0, h]])
        for axis, density in enumerate(self._force):
            q[2 * axis : 2 * axis + 2, 2 * axis : 2 * axis + 2] += density * integrated
        jumps = self._model.jumps(s)[self.active]
        directions = np.hstack([jumps, np.eye(len(self.active))])
        return np.asarray(q + directions.T @ np.diag(self._intensity * h) @ directions)

    # -- fading memory -----------------------------------------------------------------------------------------------

    def _fading_factor(self) -> float:
        """The chosen memory, shorter while the innovations deny the covariance."""
        if not self._fading or self._nis < HASTY_NIS:
            return self._fade
        return self._fade * (1.0 + min(0.01 * (self._nis - HASTY_NIS), FASTEST))

    def _remember_prior(self) -> None:
        """Measure the next constant in turn against its initial value, with the information that was forgotten; then
        bring back to its initial variance any that has passed it."""
        self._cursor = (self._cursor + 1) % len(self.active)
        if self._prior[self._cursor] > 0.0:  # else known exactly from the start
            self._recall_initial(self._cursor, float(self._prior[self._cursor]))
        for index, limit in enumerate(self._spread):
            variance = float(self._p[self.states + index, self.states + index])
            if 0.0 < limit < variance:
                self._recall_initial(index, variance * limit / (variance - limit))

    def _recall_initial(self, index: int, noise: float) -> None:
        row = self.states + index
        entry = int(self.estimated_index[row])
        unit = np.eye(len(self.estimated_index))[[row]]
        variance = np.array([[noise]])
        self._update(self._start[[index]], lambda x: x[[entry]], unit, variance, variance)

    def _tabulated_gain(self) -> Array:
        """Stationary gain (n, axes), bilinear between the table's entries at pattern angle and vibration phase."""
        angles, phases = self._table.shape[:2]
        theta = 0.5 * float(pattern(self.x[None, :4], 1.0, 0.0, 0.0)[0][0])
        along = (self.x[:4].reshape(2, 2).T @ [math.cos(theta), math.sin(theta)]) * [1.0, -1.0]
        row = (theta / math.pi + 0.5) * angles
        column = (math.atan2(along[1], along[0]) / math.tau + 0.5) * phases
        gain = np.zeros(self._table.shape[2:])
        for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)):
            a, b = math.floor(row) + i, math.floor(column) + j
            weight = (1.0 - abs(row - a)) * (1.0 - abs(column - b))
            # Half a turn of the pattern with half a period of the phase is the same motion.
            gain += weight * self._table[a % angles, (b + a // angles * (phases // 2)) % phases]
        return gain

    # -- the pattern -------------------------------------------------------------------------------------------------

    def _imposed(self, u: Array, start: Array) -> Array:
        """Virtual rotation (n,) in intervals with the drives u (n, axes, degree + 1) that begin at `start` (n,)."""
        driven = np.any(u[:, :, 0] != 0.0, axis=1) & bool(self._record["control"][0])
        turn = np.round((start + 0.5 * self.h) / self._reversal) if self._reversal > 0.0 else np.zeros(len(start))
        return np.where(driven, np.where(turn % 2 == 1, -self._virtual, self._virtual), 0.0)

    def _angles(self, predicted: Array, x: Array, virtual: Array, h: Array) -> tuple[Array, ...]:
        """The angles [rad] and ratios of `Estimates`, each (n,), for the predicted and corrected states of a block."""
        rate = x[:, self.model.names.index("rate")]
        double, energy, momentum = pattern(x, 1.0, rate + virtual, rate)
        plain, _, _ = pattern(x, 1.0, 0.0, 0.0)
        h = h.copy()
        if self._frame is None:  # the sample that sets the zero of the angle counts no rotation of its own interval
            self._frame = (rate[0] + virtual[0], rate[0])
            h[0] = 0.0
        # A prediction is read at the rate of the step's beginning, in the frame of the drive that acted in it.
        rate_before = np.concatenate([[self._frame[1]], rate[:-1]])
        self._frame = (rate[-1] + virtual[-1], rate[-1])
        ahead = 0.5 * pattern(predicted, 1.0, rate_before + virtual, rate_before)[0]
        before, theta = self._theta.unwrap(double)
        moved = ahead - before
        moved -= np.pi * np.round(moved / np.pi)
        steps = np.stack([rate * h, virtual * h, np.where(h > 0.0, moved, 0.0) + rate_before * h])
        integrated, imposed, forced = self._turned[:, None] + np.cumsum(steps, axis=1)
        self._turned = np.array([integrated[-1], imposed[-1], forced[-1]])
        _, theta_plain = self._theta_plain.unwrap(plain)
        zero, zero_plain = self._theta.start, self._theta_plain.start
        angle = integrated if self.settings.open_loop else zero - theta + forced
        turns = (angle, -forced, zero - theta - imposed, zero_plain - theta_plain - imposed, integrated)
        return *(turn / self.device.angular_gain for turn in turns), energy / 0.5, momentum / energy  # fmt: skip


def _joseph(p: Array, gain: Array, h: Array, r: Array) -> Array:
    keep = np.eye(len(p)) - gain @ h
    return np.asarray(keep @ p @ keep.T + gain @ r @ gain.T)
