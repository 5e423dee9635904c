"""The peers: a step in plain C, NumPy, and filterpy with the model in NumPy."""

import ctypes
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.speed.cases import CONTROL, DEVICE, Case
from estimator.core.compiler import command
from estimator.core.library import PATH
from estimator.core.taylor import taylor_order
from estimator.core.variant import VARIANTS, options
from estimator.oracle.filterpy_observer import FilterpyObserver
from estimator.oracle.numpy_observer import NumpyObserver
from estimator.scaling import Array

_FLAGS = ("-O3", "-std=gnu11", "-shared", "-fPIC", "-Wall", "-Wextra", "-Werror")
NATIVE: tuple[str, ...] = ("-march=native",)
SAME_ROUNDING: tuple[str, ...] = (*options(VARIANTS.get(PATH.name, ())), "-ffp-contract=off")
"""As the product's library is compiled: for the same instruction set, no product fused with a sum."""
_CONSTANTS, _DOUBLE = 9, ctypes.c_double


class HandWritten:
    """The step in step.c for a case without effects, compiled for the constants that it estimates, and as `flags` say:
    for this very processor, or so that it rounds as the product does.
    """

    def __init__(self, case: Case, flags: tuple[str, ...] = NATIVE) -> None:
        observer = case.observer()
        n, active = len(observer.estimated), observer.active
        with tempfile.TemporaryDirectory() as place:
            target, source = Path(place) / "step.so", Path(__file__).with_name("step.c")
            listed = [f"-DK={len(active)}", f"-DACTIVE={','.join(map(str, active))}"]
            subprocess.run([*command(), *_FLAGS, *flags, *listed, source, "-o", target, "-lm"], check=True)
            self._run = ctypes.CDLL(str(target)).run
        arrays, record = observer.arrays, observer.arrays.settings[0]
        self._filter = f = _filter_of(n)()
        f.h, f.fade, f.reference, f.order = observer.h, record["fade"], record["reference"], taylor_order(observer.h)
        f.virtual_rate, f.nis = CONTROL.virtual_rotation / observer.scaling.omega0, 1.0
        f.force[:], f.noise[:] = record["force_noise"].tolist(), record["noise"].tolist()
        for name in ("intensity", "prior", "spread", "initial"):
            getattr(f, name)[: len(active)] = getattr(arrays, name).tolist()
        f.x[:], f.p[:], f.c[:] = observer.x.tolist(), arrays.p.ravel().tolist(), arrays.c.ravel().tolist()
        sense, drive = case.record
        self._case = case
        self._z = np.ascontiguousarray(sense / observer.volts)
        self._u = np.ascontiguousarray(drive / observer.scaling.drive)
        self._angle, self._innovation = np.zeros(len(sense)), np.zeros((len(sense), 2))

    def seconds(self, samples: int) -> float:
        """Of the first so many samples of the record, going on from where the filter is."""
        begun = time.thread_time()
        self._go(samples)
        return time.thread_time() - begun

    def _go(self, samples: int) -> Array:
        """The angle (n,) after each of them."""
        given = (self._z, self._u, samples, self._angle, self._innovation)
        z, u, count, angle, innovation = (
            ctypes.c_long(one) if isinstance(one, int) else one.ctypes.data_as(ctypes.c_void_p) for one in given
        )
        self._run(ctypes.byref(self._filter), z, u, count, angle, innovation)
        return self._angle[:samples]

    def apart(self, samples: int = 2000) -> float:
        """Largest difference from the product's observer over the record's beginning, of the angle [rad] and of the
        state and its deviations at the end relative to the deviations; both begin anew.
        """
        observer, (sense, drive) = self._case.observer(), self._case.record
        found = observer.run(sense[:samples], drive[:samples], every=samples)
        ours, index = self._go(samples), observer.estimated_index
        deviation = np.sqrt(np.array(self._filter.c).reshape(len(index), -1).diagonal())
        theirs = found.deviation[-1][index] / np.abs(observer.factors)[index]
        states = np.abs(np.array(self._filter.x)[index] - observer.x[index]) / theirs
        return float(max(*np.abs(ours - found.angle), *states, *np.abs(deviation / theirs - 1.0)))


def _filter_of(n: int) -> type[ctypes.Structure]:
    """`filter` of step.c, of n states and constants that are estimated."""
    each = [(name, _DOUBLE * _CONSTANTS) for name in ("intensity", "prior", "spread", "initial")]
    angles = "theta theta_zero theta_plain theta_plain_zero forced rotation rate rate_integral virtual_integral"
    fields = [
        ("h", _DOUBLE), ("fade", _DOUBLE), ("force", _DOUBLE * 2), ("noise", _DOUBLE * 2), *each,
        ("virtual_rate", _DOUBLE), ("reference", _DOUBLE), ("order", ctypes.c_long), ("x", _DOUBLE * (4 + _CONSTANTS)),
        ("p", _DOUBLE * (n * n)), ("c", _DOUBLE * (n * n)), ("nis", _DOUBLE), ("time", _DOUBLE),
        ("cross", _DOUBLE * n), ("variance", _DOUBLE), ("gradient", _DOUBLE * 4),
        *((name, ctypes.c_long) for name in ("cursor", "started", "referred")),
        *((name, _DOUBLE) for name in angles.split()),
    ]  # fmt: skip
    return type("_Filter", (ctypes.Structure,), {"_fields_": fields})


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
