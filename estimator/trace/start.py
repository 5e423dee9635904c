"""Where a further pass over a record begins."""

from estimator.observer import Observer

_WIDER = 10.0  # times the standard deviations that a pass ended with is the spread of the next


def begin_about(observer: Observer, previous: Observer) -> None:
    """Give a new observer's constants the covariance `previous` ended with, widened; not the rate, which moves.

    The new observer carries what the previous one did, and may carry more behind.
    """
    states = observer.states
    block = slice(states, None)
    wide = observer.p[block, block]
    common = len(previous.p) - states
    wide[:common, :common] = previous.p[block, block] * _WIDER**2
    if "rate" in observer.model.names:
        rate = observer.estimated.index("rate") - states
        own = observer.p[states + rate, states + rate]
        wide[rate, :] = 0.0
        wide[:, rate] = 0.0
        wide[rate, rate] = own
    observer.c[:] = observer.p
