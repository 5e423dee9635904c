"""The peers: a step in C, filterpy with two models, NumPy."""

import ctypes
import math
import shutil
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any, Self

import numpy as np

from benchmarks.speed.cases import CONTROL, DEVICE, Case
from benchmarks.speed.effects_in_c import in_c
from estimator.kernel.drifts import DRIFTS
from estimator.kernel.taylor import taylor, taylor_order
from estimator.oracle.filterpy_observer import FilterpyObserver
from estimator.oracle.numpy_observer import NumpyObserver
from estimator.scaling import Array

_SOURCE = Path(__file__).with_name("step.c")
_FLAGS = ("-O3", "-march=native", "-std=gnu11", "-shared", "-fPIC", "-Wall", "-Wextra", "-Werror")


def compiler() -> str | None:
    """A C compiler, None where there is none."""
    return next((found for name in ("cc", "gcc", "clang") if (found := shutil.which(name)) is not None), None)


class HandWritten:
    """The C step for a case."""

    def __init__(self, library: Any, case: Case) -> None:
        self._run = library.run
        observer = case.observer()
        n, k = len(observer.estimated), len(observer.active)
        constants = len(observer.x) - observer.states

        class Filter(ctypes.Structure):
            _fields_ = [
                ("h", ctypes.c_double), ("fade", ctypes.c_double), ("force", ctypes.c_double * 2),
                ("noise", ctypes.c_double * 2),
                *((name, ctypes.c_double * constants) for name in ("intensity", "prior", "spread", "initial")),
                ("virtual_rate", ctypes.c_double), ("reference", ctypes.c_double), ("order", ctypes.c_long * 8),
                ("x", ctypes.c_double * len(observer.x)), ("p", ctypes.c_double * (n * n)),
                ("c", ctypes.c_double * (n * n)), ("nis", ctypes.c_double),
                ("time", ctypes.c_double), ("cross", ctypes.c_double * n), ("variance", ctypes.c_double),
                ("gradient", ctypes.c_double * 4), ("cursor", ctypes.c_long), ("started", ctypes.c_long),
                ("referred", ctypes.c_long), *((name, ctypes.c_double) for name in (
                    "theta", "theta_zero", "theta_plain", "theta_plain_zero", "forced", "rotation", "rate",
                    "rate_integral", "virtual_integral")),
            ]  # fmt: skip

        record = observer.arrays.settings[0]
        self._filter = f = Filter()
        f.h, f.fade, f.reference = observer.h, record["fade"], record["reference"]
        parts = [abs(part) * observer.h for part in DRIFTS] if case.effects else [observer.h] * 8
        f.order[:] = [taylor_order(part) for part in parts]
        f.virtual_rate, f.nis = CONTROL.virtual_rotation / observer.scaling.omega0, 1.0
        f.force[:], f.noise[:] = record["force_noise"].tolist(), record["noise"].tolist()
        arrays = observer.arrays
        for name, values in {
            "intensity": arrays.intensity, "prior": arrays.prior, "spread": arrays.spread, "initial": arrays.initial
        }.items():  # fmt: skip
            getattr(f, name)[:k] = values.tolist()
        f.x[:] = observer.x.tolist()
        f.p[:] = arrays.p.ravel().tolist()
        f.c[:] = arrays.c.ravel().tolist()
        sense, drive = case.record
        self._z = np.ascontiguousarray(sense / observer.volts)
        self._u = np.ascontiguousarray(drive / observer.scaling.drive)
        self._angle, self._innovation = np.zeros(len(sense)), np.zeros((len(sense), 2))

    @classmethod
    def built(cls, case: Case) -> Self | None:
        """Compiled for the constants that the case estimates; None without a compiler."""
        if (found := compiler()) is None:
            return None
        observer = case.observer()
        active = observer.active
        with tempfile.TemporaryDirectory() as place:
            target = Path(place) / "step.so"
            listed = ",".join(map(str, active))
            forces = Path(place) / "effects.h"
            forces.write_text(in_c(observer.model, [e for _, e in observer.effects]) if case.effects else "")
            command = [
                found,
                *_FLAGS,
                f"-DK={len(active)}",
                f"-DACTIVE={listed}",
                "-include",
                str(forces),
                str(_SOURCE),
                "-o",
                str(target),
                "-lm",
            ]
            subprocess.run(command, check=True)
            return cls(ctypes.CDLL(str(target)), case)

    def seconds(self, samples: int) -> float:
        """Of the first so many samples of the record, going on from where the filter is."""
        begun = time.thread_time()
        self.go(samples)
        return time.thread_time() - begun

    def go(self, samples: int) -> Array:
        """The angle (n,) after the first so many samples."""
        double = ctypes.POINTER(ctypes.c_double)
        pointers = [array.ctypes.data_as(double) for array in (self._z, self._u, self._angle, self._innovation)]
        z, u, angle, innovation = pointers
        self._run(ctypes.byref(self._filter), z, u, ctypes.c_long(samples), angle, innovation)
        return self._angle[:samples]

    def apart(self, case: Case, samples: int = 2000) -> float:
        """Largest difference from the product's observer over the record's beginning, of the angle [rad] and of the
        state and its deviations at the end relative to the deviations; both begin anew.
        """
        observer, (sense, drive) = case.observer(), case.record
        found = observer.run(sense[:samples], drive[:samples], every=samples)
        ours = np.array(self.go(samples))
        n = len(observer.estimated)
        deviation = np.sqrt(np.array(self._filter.c).reshape(n, n).diagonal())
        state = np.array(self._filter.x)[observer.estimated_index]
        scale = np.abs(observer.factors)[observer.estimated_index]
        theirs = found.deviation[-1][observer.estimated_index] / scale
        return float(
            max(
                np.max(np.abs(ours - found.angle)),
                np.max(np.abs(state - observer.x[observer.estimated_index]) / theirs),
                np.max(np.abs(deviation / theirs - 1.0)),
            )
        )


class Filterpy:
    """filterpy's EKF as its manual has it, one covariance, the flow and its Jacobian from the compiled kernel."""

    def __init__(self, case: Case) -> None:
        from filterpy.kalman import ExtendedKalmanFilter

        observer = case.observer()
        self._filter = f = ExtendedKalmanFilter(dim_x=13, dim_z=2)
        f.x, f.P = observer.x[:, None].copy(), observer.covariances[0]
        record = observer.arrays.settings[0]
        f.R = np.diag(record["noise"])
        self._h, self._order = observer.h, int(record["order"])
        f.Q = np.zeros((13, 13))
        f.Q[np.arange(1, 4, 2), np.arange(1, 4, 2)] = record["force_noise"] * observer.h
        f.Q[4:, 4:] = np.diag(observer.random_walk_intensity * observer.h)
        self._jacobian = np.zeros((2, 13))
        self._jacobian[0, [0, 4]] = self._jacobian[1, [2, 5]] = 1.0
        self._fade = float(record["fade"])
        self._scratch = [np.zeros((4, 12)) for _ in range(2)]
        self._number = observer.number
        sense, drive = case.record
        self._z, self._u = sense / observer.volts, np.ascontiguousarray(drive / observer.scaling.drive)[:, :, None]
        self._at = 0

    def seconds(self, samples: int) -> float:
        """Of the next so many samples."""
        f, jacobian = self._filter, self._jacobian
        term, out = self._scratch
        begun = time.thread_time()
        for m in range(self._at, self._at + samples):
            x = f.x[:, 0]
            out[:] = 0.0
            out[:, 0] = x[:4]
            out[:, 1:5] = np.eye(4)
            taylor(self._number, x[4:], self._u[m], self._h, self._order, 12, term, out)
            f.F[:4, :4], f.F[:4, 6:] = out[:, 1:5], out[:, 5:]
            moved = np.concatenate([out[:, 0], x[4:]])[:, None]
            f.predict_x = lambda u=0, moved=moved: setattr(f, "x", moved)
            f.P *= self._fade
            f.predict()
            f.update(self._z[m][:, None], lambda _: jacobian, lambda x: jacobian @ x)
        self._at = (self._at + samples) % (len(self._z) - samples)
        spent = time.thread_time() - begun
        assert math.isfinite(float(f.x[0, 0]))
        return spent


class Oracle:
    """An oracle of the product: the observer in NumPy, or with filterpy's matrices and the model in NumPy."""

    def __init__(self, case: Case, make: type[NumpyObserver] = NumpyObserver) -> None:
        self._observer = make(DEVICE, case.settings, CONTROL)
        self._sense, self._drive = case.record
        self._at = 0

    def seconds(self, samples: int) -> float:
        """Of the next so many samples."""
        part = slice(self._at, self._at + samples)
        begun = time.thread_time()
        self._observer.run(self._sense[part], self._drive[part], every=samples)
        self._at = (self._at + samples) % (len(self._sense) - samples)
        return time.thread_time() - begun


def filterpy_with_numpy(case: Case) -> Any:
    """`seconds` of the oracle that lets filterpy do prediction and update."""
    return Oracle(case, FilterpyObserver).seconds
