"""What a verb does about effects of one's own before it begins: they are compiled, and it says so."""

import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from hil.bench import Bench


def prepare(bench: "Bench") -> None:
    """Compile the effects of `bench` and of packages that the cache does not have, with a line for each on standard
    error, and a line for each of a package that is left out.

    Raises InputError for one that the bench file declares or names and that is none.
    """
    from hil.cli.show import say
    from hil.inputs.own_effects import left_out, may_have_any

    if not may_have_any(bench):
        return
    from hil.inputs.declared import device_of

    device = device_of(bench)
    for line in left_out():
        say(line)
    if not device.own:
        return
    from estimator.core.own import address, is_compiled
    from estimator.model.catalogue import model_for

    _, model = model_for(device.axes)
    for effect in device.own:
        present = effect.on(device.axes)
        if present is None or is_compiled(present, model):
            continue
        begin = time.perf_counter()
        address(present, model)
        say(f"effect {effect.name}: compiled in {time.perf_counter() - begin:.1f} s, once for this law")
