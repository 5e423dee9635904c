"""One pass over a record with an observer that lacks the effects it watches: how much each would explain."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from estimator.kernel.flow import taylor_order
from estimator.kernel.layout import OUTPUT
from estimator.kernel.scan import scan_block
from estimator.observer import Observer
from estimator.scaling import Array
from estimator.settings import ControllerSettings, Device, ObserverSettings
from estimator.trace.record import Record
from estimator.trace.start import begin_about

PARTS = 32
_JUMP = 4.0  # times the usual innovation: what lies around a jump of the rate counts less from there on
Watched = Mapping[str, Mapping[str, float]]


@dataclass(frozen=True)
class Scan:
    """Normal equations of the watched coefficients, by part of the record, scaled to their plausible sizes.

    normal (parts, k, k), score (parts, k); columns: those of each watched effect; plausible (k,) SI sizes; innovation
    and its predicted deviation (n, axes) V; observer: as it stands after the last sample.
    """

    columns: dict[str, slice]
    normal: Array
    score: Array
    plausible: Array
    innovation: Array
    deviation: Array
    observer: Observer

    @property
    def ratio(self) -> float:
        """Innovation over what was predicted of it, rms."""
        return float(np.sqrt(np.nanmean((self.innovation / self.deviation) ** 2)))


def scan(
    record: Record,
    device: Device,
    settings: ObserverSettings,
    controller: ControllerSettings | None,
    watched: Watched,
    previous: Observer | None = None,
) -> Scan:
    """Run the observer of `settings` over the record and follow the signatures of the effects in `watched`.

    watched: by name, each with its parameters in SI; previous: an observer whose pass over the record came before.
    Raises ModelError as `Observer` does.
    """
    plain = replace(settings, effects={**settings.effects, **watched})
    observer = Observer(device, plain, controller, watched=len(watched))
    if previous is not None:
        begin_about(observer, previous)
    columns, plausible, first = {}, [], 0
    for _, effect in observer.effects[observer.carried :]:
        columns[effect.name] = slice(first, first + len(effect.coefficients))
        first += len(effect.coefficients)
        plausible += [coefficient.plausible for coefficient in effect.coefficients]
    scale = np.array(plausible)
    z, u, h, warmth = observer.scaled(record.sense, record.drive, record.step, record.channels.get("temperature"))
    observer.record["order"] = taylor_order(float(np.max(h, initial=observer.h))) + u.shape[2] - 1
    rows = np.zeros(len(record), OUTPUT)
    delta = np.zeros((observer.states + len(observer.active), first))
    normal, score = np.zeros((PARTS, first, first)), np.zeros((PARTS, first))
    edges = np.linspace(0, len(record), PARTS + 1).astype(int)
    level = _JUMP
    for part, (begin, end) in enumerate(pairwise(edges)):
        span = slice(begin, end)
        scan_block(
            observer.record, observer.active, observer.walk, observer.prior, observer.spread, observer.guess,
            observer.table, observer.x, observer.p, observer.c, observer.memory,
            z[span], u[span], h[span], warmth[span], rows[span], delta, level, normal[part], score[part],
        )  # fmt: skip
        with np.errstate(invalid="ignore"):
            usual = np.nanmedian(rows["nu"][span, : device.axes] ** 2 / rows["s"][span, : device.axes]) / 0.455
        level = _JUMP * max(1.0, float(usual))
    volts = np.array([observer.scaling.sense(axis) for axis in range(device.axes)])
    return Scan(
        columns=columns,
        normal=normal * np.outer(scale, scale),
        score=score * scale,
        plausible=scale * np.abs(observer.factors[len(observer.names) - first :]),
        innovation=np.where(np.isfinite(record.sense), rows["nu"][:, : device.axes] * volts, np.nan),
        deviation=np.sqrt(rows["s"][:, : device.axes]) * np.abs(volts),
        observer=observer,
    )
