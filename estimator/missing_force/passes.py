"""Forward and backward over a record with a gain that has settled: compiled."""

import numpy as np

from estimator.kernel.compiled import compiled


@compiled
def forward(transition, by_rate, turning, added, sense, seen, gain, start, predicted, innovation):  # type: ignore[no-untyped-def]
    """Predicted states (n, m) and innovations (n, axes), 0 where a sample is lost.

    transition (m, m); by_rate (s, s) its derivative by the rate, of the motion; turning (n,) the rate about which it is
    not expanded; added (n, s): what is known to push over the interval that ends at each sample; start (m,): the
    prediction of the first sample.
    """
    m, s, axes = len(start), by_rate.shape[0], sense.shape[1]
    x = start.copy()
    y = np.zeros(m)
    for k in range(len(sense)):
        for i in range(m):
            predicted[k, i] = x[i]
        for a in range(axes):
            value = sense[k, a]
            left = 0.0
            if np.isfinite(value):
                left = value
                for i in range(m):
                    left -= seen[a, i] * x[i]
            innovation[k, a] = left
        for i in range(m):
            for a in range(axes):
                x[i] += gain[i, a] * innovation[k, a]
        if k + 1 == len(sense):
            break
        for i in range(m):
            total = 0.0
            for j in range(m):
                total += transition[i, j] * x[j]
            y[i] = total
        for i in range(s):
            total = added[k + 1, i]
            for j in range(s):
                total += turning[k + 1] * by_rate[i, j] * x[j]
            y[i] += total
        for i in range(m):
            x[i] = y[i]


@compiled
def backward(transition, by_rate, turning, seen, gain, weight, covariance, innovation, states):  # type: ignore[no-untyped-def]
    """Turn predicted states (n, m) into smoothed ones, in place (Bryson and Frazier).

    weight (axes, axes): the inverse of the innovation's covariance; covariance (m, m) of the prediction.
    """
    n, m = states.shape
    s, axes = by_rate.shape[0], seen.shape[0]
    adjoint = np.zeros(m)
    back = np.zeros(m)
    known = np.zeros(axes)
    for k in range(n - 1, -1, -1):
        if k + 1 < n:
            for i in range(m):
                total = 0.0
                for j in range(m):
                    total += transition[j, i] * adjoint[j]
                back[i] = total
            for i in range(s):
                for j in range(s):
                    back[i] += turning[k + 1] * by_rate[j, i] * adjoint[j]
        else:
            for i in range(m):
                back[i] = 0.0
        present = False
        for a in range(axes):
            if innovation[k, a] != 0.0:
                present = True
        if present:
            for a in range(axes):
                total = 0.0
                for b in range(axes):
                    total += weight[a, b] * innovation[k, b]
                for j in range(m):
                    total -= gain[j, a] * back[j]
                known[a] = total
            for i in range(m):
                total = back[i]
                for a in range(axes):
                    total += seen[a, i] * known[a]
                adjoint[i] = total
        else:
            for i in range(m):
                adjoint[i] = back[i]
        for i in range(m):
            total = 0.0
            for j in range(m):
                total += covariance[i, j] * adjoint[j]
            states[k, i] += total
