"""The armed board at the other end while a loop runs: seen to when no samples come, and brought to SAFE at the end."""

import time
from collections.abc import Iterable

from hil.wire import client
from hil.wire.codec import type_of
from hil.wire.endpoint import Endpoint
from hil.wire.errors import LinkError, ProtocolError, WireError
from hil.wire.messages import Message, Nack, NackReason, SafeReason, State, Status
from hil.wire.sense import Sense


class ArmedBoard:
    """`drive` is the message that closes the loop; silence is borne for `silence_s`, for ever if `patient`."""

    def __init__(self, endpoint: Endpoint, drive: type[Message], silence_s: float, *, patient: bool) -> None:
        self._endpoint = endpoint
        self._drive = type_of(drive)
        self._silence_s = silence_s
        self._patient = patient

    def attend(self, said: Iterable[Message]) -> bool:
        """No sample came: by what the board has said meanwhile, arm it again after its watchdog, ask after a silence,
        and give up; whether it was armed again.

        In lockstep silence is no fault: whoever stopped the board in a debugger will let it go on.
        """
        safe = False
        for message in said:
            if isinstance(message, Status):
                safe = message.state == State.SAFE
            elif isinstance(message, Nack):  # the STATUS was lost, but the board refuses to be driven
                safe = safe or (message.of_type == self._drive and message.reason == NackReason.BAD_STATE)
        if not safe and not self._patient:
            safe = self._silent()
        if safe:
            self._arm_again()
        return safe

    def heard(self) -> list[Message]:
        """What the board has said beside samples, which stay for the loop."""
        items = self._endpoint.poll(0.0)
        self._endpoint.keep([item for item in items if isinstance(item.message, Sense)])
        return [item.message for item in items]

    def farewell(self, reason: SafeReason) -> dict[str, int]:
        """Bring the board to SAFE; its own counters, by name, none when it no longer answers."""
        try:
            status = client.make_safe(self._endpoint, reason, self._silence_s)
        except WireError:  # a board that no longer answers goes SAFE by its own watchdog
            return {}
        names = ("late", "held", "bad_frames", "lost_seq", "saturated", "watchdog_trips", "dropped")
        return {name: getattr(status, name) for name in names}

    def _silent(self) -> bool:
        """Half the patience for silence is over: whether the board, told to be SAFE, says that it is."""
        if time.monotonic_ns() - self._endpoint.received_ns < 0.5e9 * self._silence_s:
            return False
        try:
            client.make_safe(self._endpoint, SafeReason.LINK_LOST, 0.5 * self._silence_s)
        except LinkError:
            raise ProtocolError(
                f"{self._endpoint.link.name}: the board fell silent for {self._silence_s:g} s; "
                "check its supply and the cable"
            ) from None
        return True

    def _arm_again(self) -> None:
        try:
            client.arm(self._endpoint, self._silence_s)
        except ProtocolError as refusal:
            raise ProtocolError(f"{refusal}; if it restarted, check its supply") from None
        self.heard()  # refusals from before it was armed
