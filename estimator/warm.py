"""`python -m estimator.warm [--all] [EFFECT …]`: compile the kernels into the cache, so that the first sample of a run
is as quick as the rest; with --all those too that few runs need, with names of effects the step for these together.
"""

import sys
import time
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from estimator.compiling import CONTROLLER, DEVICE, PIECES, SELDOM, Piece, compile_side_by_side, observer_with, watch
from estimator.effects.catalogue import effect_for
from estimator.errors import ModelError
from estimator.foresight import rehearse
from estimator.gain_matrix import luenberger
from estimator.kernel.compiled import COMMON, GAIN_MODE, STATIONARY, is_warm, mark_warm
from estimator.observer import Observer
from estimator.settings import Device, Gain, ObserverSettings
from estimator.simulation import simulate


class Kernels(NamedTuple):
    """What is compiled together: what can be compiled apart, then a call of each kernel with the types of a run, for
    what is left.
    """

    pieces: Mapping[str, Piece]
    call_each: Callable[[], None]


def _of_every_run() -> None:
    for gain in (Gain.EKF, Gain.FADING):
        for vector in (False, True):
            watch(gain, vector=vector)
        _use(observer_with(gain))
        one = Device(4000.0, (1.6e6,), (1.0,), 1e-4, (-890.0,), (1e-4,))
        _use(Observer(one, ObserverSettings(gain=gain, memory=0.01)))
        observer_with(gain).tick(0.0, 0.0, 0.0, 0.0)


def _of_stationary_gain() -> None:
    _use(observer_with(Gain.STATIONARY))
    observer_with(Gain.STATIONARY).tick(0.0, 0.0, 0.0, 0.0)


def _of_gain_mode() -> None:
    for gain in (Gain.EKF, Gain.FADING):
        made = observer_with(gain)
        rehearse(made, luenberger(made.h))


def _use(observer: Observer) -> None:
    """A sample, a block, a free run."""
    axes = observer.device.axes
    sense = np.zeros((2, axes))
    observer.run(sense, sense, truth=np.zeros((2, len(observer.x))))
    simulate(observer, observer.state, sense, sensitive=True)


KERNELS = {
    COMMON: Kernels(PIECES, _of_every_run),
    STATIONARY: Kernels({"stationary": SELDOM["stationary"]}, _of_stationary_gain),
    GAIN_MODE: Kernels({"gain mode": SELDOM["gain mode"]}, _of_gain_mode),
}


def warm(names: list[str]) -> list[str]:
    """Compile those of KERNELS by these names that are not in the cache; which they were."""
    cold = [name for name in names if not is_warm(name)]
    if cold:
        compile_side_by_side({piece: what for name in cold for piece, what in KERNELS[name].pieces.items()})
    for name in cold:
        KERNELS[name].call_each()
        mark_warm(name)
    return cold


def compile_step(effects: list[str]) -> None:
    """The step for a set of effects of the catalogue, with the parameters that each must be given set to something."""
    given = {
        name: {parameter.name: 1.0 for parameter in effect_for(name, 2)[1].parameters if parameter.default is None}
        for name in effects
    }
    observer = Observer(DEVICE, ObserverSettings(effects=given), CONTROLLER)
    if not observer.may_have_step:
        raise ModelError(f"there is no step for {', '.join(effects)}: a path is late, or a force turns over")
    observer.compile_step()


def main() -> None:
    """Warm the cache unless it is warm; one line either way, and one for a step."""
    begin = time.perf_counter()
    everything = "--all" in sys.argv[1:]
    names = list(KERNELS) if everything else [COMMON]
    if not all(map(is_warm, names)):
        print("compiling the kernels, once for this version … ", end="", flush=True)
    cold = warm(names)
    print(f"kernels {'compiled' if cold else 'are warm'}: {time.perf_counter() - begin:.1f} s")
    if effects := [name for name in sys.argv[1:] if name != "--all"]:
        begin = time.perf_counter()
        try:
            compile_step(effects)
        except ModelError as error:
            raise SystemExit(f"estimator.warm: {error}") from None
        print(f"the step for {', '.join(effects)}: {time.perf_counter() - begin:.1f} s")


if __name__ == "__main__":
    main()
