"""How a pass over a record begins: about what an earlier one found, and when its start is over."""

from estimator.observer import Observer
from estimator.settings import Device, ObserverSettings
from estimator.thresholds import THRESHOLDS

_SET = THRESHOLDS.start


def begin_about(observer: Observer, previous: Observer) -> None:
    """Give a new observer's constants the covariance `previous` ended with, widened (`Observer.begin_about`)."""
    observer.begin_about(previous, _SET.wider)


def settled_from(settings: ObserverSettings, device: Device, samples: int) -> int:
    """First of so many samples that is scored: behind the start, but not beyond a share of a short record."""
    return min(settling(settings, device), samples // _SET.most)


def settling(settings: ObserverSettings, device: Device) -> int:
    """Samples after which a start from the declared values is over."""
    return int(_SET.memories * min(settings.memory, _SET.longest_memory) * device.sample_rate)
