"""The trim outputs of a board that is not armed: what it tells of them, beside what the bench file declares."""

import math
from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

from estimator.trims import Electrode
from hil.bench import Bench
from hil.bench.plausible import LARGEST_V
from hil.errors import InputError
from hil.inputs.captured import declared_electrodes
from hil.wire import client
from hil.wire.endpoint import Endpoint
from hil.wire.errors import ProtocolError
from hil.wire.messages import Capabilities, Identity, TrimOutput, TrimRead

MOST, _SLOWEST_S = 8, 600.0


class Output(NamedTuple):
    """One that the bench file declares: what the board tells of it, largest magnitude in V that may be put out with its
    sign, and the electrode for the observer."""

    told: TrimOutput
    most_V: float
    electrode: Electrode

    @property
    def register(self) -> str:
        return f"TRIM_{self.told.output}"

    def code(self, volts: float) -> int:
        return int(min(max(round(volts / self.told.scale_V), self.told.lowest), self.told.highest))


def read_outputs(endpoint: Endpoint, identity: Identity, timeout_s: float) -> list[TrimOutput]:
    """What a board tells of its trim outputs, none of one that has none.

    Raises ProtocolError where it tells what no board has, and as `client.request`.
    """
    if not Capabilities.TRIM & identity.capabilities:
        return []
    found: list[TrimOutput] = []
    count = 1
    while len(found) < count:
        number = len(found)
        told = client.request(endpoint, TrimRead(number), TrimOutput, timeout_s, partial(_is_of, number))
        if wrong := _wrong(told, count if found else told.outputs):
            raise ProtocolError(f"{endpoint.link.name}: TRIM_OUTPUT {number}: {wrong}; correct the firmware")
        count = told.outputs
        found.append(told)
    return found


def _is_of(number: int, told: TrimOutput) -> bool:
    return told.output == number


def _wrong(told: TrimOutput, count: int) -> str:
    largest_V = max(-told.lowest, told.highest) * told.scale_V
    checks = (
        (1 <= told.outputs <= MOST and told.outputs == count, f"outputs is {told.outputs}, must be one number, 1 to 8"),
        (told.lowest <= 0 <= told.highest and told.lowest < told.highest, "its codes are no range around 0"),
        (math.isfinite(told.scale_V) and told.scale_V > 0.0, f"scale_V is {told.scale_V:g}, must be positive"),
        (largest_V <= LARGEST_V, f"its range ends at {largest_V:g} V, no board has that"),
        (0.0 <= told.settling_s <= _SLOWEST_S, f"settling_s is {told.settling_s:g}, must be 0 to {_SLOWEST_S:g}"),
        (bool(told.name), "its name is empty"),
    )
    return next((words for right, words in checks if not right), "")


def require_outputs(endpoint: Endpoint, identity: Identity, bench: Bench) -> list[Output]:
    """The outputs of the electrodes that the bench file declares, in its order; none where it declares none.

    Raises InputError for a board that has not all of them, and as `read_outputs`.
    """
    trim, link = bench.trim, endpoint.link.name
    if not trim.electrodes:
        return []
    told = {one.name: one for one in read_outputs(endpoint, identity, bench.link.timeout_s)}
    if not told:
        raise InputError(f"{link}: the board has no trim outputs; take [trim] electrodes out of the bench file")
    for name in trim.electrodes:
        if name not in told:
            raise InputError(f"{link}: [trim] electrodes: the board has no output {name!r}; it has {', '.join(told)}")
    outputs = []
    electrodes = declared_electrodes(bench, [told[name].settling_s for name in trim.electrodes])
    for name, electrode in zip(trim.electrodes, electrodes, strict=True):
        one = told[name]
        end = one.highest if one.highest >= -one.lowest else one.lowest
        most_V = math.copysign(min(abs(end) * one.scale_V, trim.limit_V or math.inf), end)
        outputs.append(Output(one, most_V, electrode))
    return outputs


def zeroed(endpoint: Endpoint, outputs: Sequence[Output], timeout_s: float) -> dict[str, float]:
    """Their registers, which are 0 while nothing streams, written and read back.

    Raises ProtocolError where one is not, and as `client.request`.
    """
    for output in outputs:
        name = output.register
        client.write_register(endpoint, name, 0, timeout_s)
        if held := client.read_register(endpoint, name, timeout_s):
            raise ProtocolError(
                f"{endpoint.link.name}: {name} reads {held:g} in a board that is not armed, must be 0; "
                "correct the firmware"
            )
    return {output.register: 0.0 for output in outputs}
