"""Two entries that know nothing of effects: the best linear model, and a black box from a published package.

Both predict a sample from the last samples of both channels and the drives, and feed what they predicted back for the
200 samples that are asked for.  Linear: an ARX model by least squares, of the order that predicts best on the last
fifth of what is given.  Black box: scikit-learn's network (MLPRegressor) on the same regressors, added to the linear
model.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.challenge.task import ASKED, SEEN, Floats, Record, answer, opened

ORDERS = (2, 4, 8, 16)
_HIDDEN, _ITERATIONS = (32, 32), 60
_TRIED = 60  # stretches of the last fifth that an order is chosen on

Step = Callable[[Floats, Floats], Floats]
"""Past sense (k, order, 2) and drive (k, order + 1, 2) to the next sense (k, 2)."""


def regressors(past: Floats, drive: Floats) -> Floats:
    """(k, features), a constant among them."""
    k = len(past)
    return np.hstack([past.reshape(k, -1), drive.reshape(k, -1), np.ones((k, 1))])


def _table(record: Record, order: int) -> tuple[Floats, Floats]:
    """Regressors of every sample of the given part, and the samples."""
    n = len(record.sense)
    at = np.arange(order, n)
    past = record.sense[at[:, None] - order + np.arange(order)]
    drive = record.drive[at[:, None] - order + np.arange(order + 1)]
    x, y = regressors(past, drive), record.sense[at]
    good = np.isfinite(x).all(axis=1) & np.isfinite(y).all(axis=1)
    return x[good], y[good]


def linear(record: Record, order: int, share: float = 1.0) -> Floats:
    """Coefficients (features, 2) from the first `share` of what is given."""
    x, y = _table(record, order)
    count = round(share * len(x))
    scale = np.maximum(np.abs(x[:count]).max(axis=0), 1e-300)
    return np.asarray(np.linalg.lstsq(x[:count] / scale, y[:count], rcond=None)[0] / scale[:, None])


def run_on(step: Step, order: int, sense: Floats, drive: Floats, samples: int) -> Floats:
    """Predict `samples` after sense (k, n, 2) with drive (k, n + samples, 2), each from those before."""
    k, n = sense.shape[:2]
    course = np.concatenate([np.nan_to_num(sense), np.zeros((k, samples, 2))], axis=1)
    for m in range(n, n + samples):
        course[:, m] = step(course[:, m - order : m], drive[:, m - order : m + 1])
    return course[:, n:]


def linear_step(found: Floats) -> Step:
    """The linear model with these coefficients (features, 2)."""
    return lambda past, u: np.asarray(regressors(past, u) @ found)


def network_step(record: Record, order: int, found: Floats) -> Step:
    """A network trained on what the linear model leaves of the given part, added to it."""
    from sklearn.neural_network import MLPRegressor
    from sklearn.preprocessing import StandardScaler

    x, y = _table(record, order)
    scaler = StandardScaler().fit(x[:, :-1])
    left = y - x @ found
    size = left.std(axis=0)
    network = MLPRegressor(hidden_layer_sizes=_HIDDEN, max_iter=_ITERATIONS, random_state=0, early_stopping=True)
    network.fit(scaler.transform(x[:, :-1]), left / size)

    def step(past: Floats, u: Floats) -> Floats:
        row = regressors(past, u)
        return np.asarray(row @ found + network.predict(scaler.transform(row[:, :-1])) * size)

    return step


def chosen_order(record: Record) -> int:
    """The order of the linear model that predicts the last fifth best, 200 samples ahead."""
    n = len(record.sense)
    starts = np.linspace(0.8 * n, n - SEEN - ASKED, _TRIED).astype(int)
    rows = starts[:, None] + np.arange(SEEN + ASKED)
    sense, drive = record.sense[rows], record.drive[rows]

    def error(order: int) -> float:
        said = run_on(linear_step(linear(record, order, 0.8)), order, sense[:, :SEEN], drive, ASKED)
        apart = float(np.nanmean((said - sense[:, SEEN:]) ** 2))
        return apart if np.isfinite(apart) else np.inf

    return min(ORDERS, key=error)


def entries(folder: Path, answers: Path) -> None:
    """Answers of both, below `answers`."""
    for record in opened(folder):
        order = chosen_order(record)
        found = linear(record, order)
        for name, step in (("linear", linear_step(found)), ("network", network_step(record, order, found))):
            said = run_on(step, order, record.window_sense, record.window_drive, ASKED)
            answer(answers / name, record.name, said)
