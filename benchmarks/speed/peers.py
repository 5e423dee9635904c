"""The peers: NumPy, and filterpy with the model in NumPy."""

import time
from typing import Any

from benchmarks.speed.cases import CONTROL, DEVICE, Case
from estimator.oracle.filterpy_observer import FilterpyObserver
from estimator.oracle.numpy_observer import NumpyObserver


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
