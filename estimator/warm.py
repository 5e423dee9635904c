"""`python -m estimator.warm [EFFECT …]`: compile every kernel into the cache, so that the first sample of a run is as
quick as the rest; with names of effects, the step for these effects together as well.
"""

import sys
import time

import numpy as np

from estimator.compiling import CONTROLLER, DEVICE, compile_side_by_side, watch
from estimator.effects.catalogue import effect_for
from estimator.errors import ModelError
from estimator.foresight import rehearse
from estimator.gain_matrix import luenberger
from estimator.kernel.compiled import is_warm, mark_warm
from estimator.observer import Observer
from estimator.settings import Device, Gain, ObserverSettings
from estimator.simulation import simulate


def compile_all() -> None:
    """Call each kernel once with the types of a run: every model and gain, a sample, a block, a free run, a matrix."""
    sense = np.zeros((2, 2))
    for axes in (1, 2):
        device = DEVICE if axes == 2 else Device(4000.0, (1.6e6,), (1.0,), 1e-4, (-890.0,), (1e-4,))
        for gain in Gain if axes == 2 else (Gain.EKF, Gain.FADING):
            settings = ObserverSettings(gain=gain, memory=0.01)
            observer = Observer(device, settings, CONTROLLER if axes == 2 else None)
            observer.run(sense[:, :axes], sense[:, :axes], truth=np.zeros((2, len(observer.x))))
            simulate(observer, observer.state, sense[:, :axes], sensitive=True)
            if axes == 2:
                observer.tick(0.0, 0.0, 0.0, 0.0)
                for vector in (False, True) if gain is not Gain.STATIONARY else ():
                    watch(gain, vector=vector)
                rehearse(observer, luenberger(observer.h))


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
    known = is_warm()
    if not known:
        print("compiling the kernels, once for this version … ", end="", flush=True)
        compile_side_by_side()
        compile_all()
        mark_warm()
    print(f"kernels {'are warm' if known else 'compiled'}: {time.perf_counter() - begin:.1f} s")
    if effects := sys.argv[1:]:
        begin = time.perf_counter()
        try:
            compile_step(effects)
        except ModelError as error:
            raise SystemExit(f"estimator.warm: {error}") from None
        print(f"the step for {', '.join(effects)}: {time.perf_counter() - begin:.1f} s")


if __name__ == "__main__":
    main()
