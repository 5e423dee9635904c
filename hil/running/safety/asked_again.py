"""A board that has said SAFE, asked once more: it refuses a drive, takes what only a stopped board takes, and holds
what was written to it.

STATUS is the board's own word.  In lockstep it is all there is, as a board that goes on driving streams nothing until
it is driven: so a drive of zero is offered, which a board in SAFE refuses.  docs/safety.md, The host, rule 5.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass, field

from hil.wire import client
from hil.wire.codec import type_of
from hil.wire.endpoint import Endpoint
from hil.wire.errors import LinkError, WireError
from hil.wire.messages import DriveBoard, DriveForce, DriveGains, Message, Nack, NackReason, State, Status
from hil.wire.sense import Sense
from hil.wire.spec import SPEC

_ASKED = 8  # times within the patience: lines lose frames
_PATIENCE_S = 2.0  # at least, as for any register: SAFE is confirmed, and a machine may stand still meanwhile
_LONGEST_S = 10.0  # for a board that has refused the drive: it is SAFE, and what it runs on may be busy for long
_STREAMING = (State.ARMED, State.RUNNING)


@dataclass
class Asked:
    """What came of it.

    Attributes:
        drives: why the board is not SAFE although it says so, "" if it is.
        odd: what it says or holds that no board does which keeps to the page, one clause each.
        refused: whether it refused a drive, as a board in SAFE does.
    """

    drives: str = ""
    odd: list[str] = field(default_factory=list)
    refused: bool = False


def zero_drive(drive: type[Message], tick: int) -> Message:
    """The drive message of a loop mode that drives nothing, for the interval after `tick`."""
    effective = (tick + 1) & 0xFFFFFFFF
    if drive is DriveGains:
        return DriveGains(1, (0.0,) * 8, (0.0,) * 2, effective)
    if drive is DriveBoard:
        return DriveBoard(0)
    return DriveForce(0, 0, effective)


def ask_again(endpoint: Endpoint, probe: Message, registers: Mapping[str, float], patience_s: float) -> Asked:
    """Offer `probe`, read all `registers` and write SESSION once more. Raises nothing that the link does."""
    asked = Asked()
    charged = any(map(_is_trim, registers))  # its trim outputs, as long as they do not read as 0
    try:
        _offer(endpoint, probe, patience_s, asked)
        if not asked.drives:
            _read_trims(endpoint, registers, max(patience_s, _PATIENCE_S), asked)
        charged = charged and bool(asked.drives)
        if not asked.drives:
            _read(endpoint, registers, max(patience_s, _LONGEST_S if asked.refused else _PATIENCE_S), asked)
    except WireError as error:  # what the board said before stands
        asked.odd.append(f"it could not be asked once more: {error}")
        if charged:
            asked.drives = "whether its trim outputs are at 0 cannot be read any more"
    return asked


def _offer(endpoint: Endpoint, probe: Message, patience_s: float, asked: Asked) -> None:
    """Whether the board refuses a drive, as it does in SAFE and nowhere else.  One that says nothing may be waiting for
    the machine it runs on; one that still streams after `patience_s` is not waited for.
    """
    begin = time.monotonic()
    longest = max(patience_s, _PATIENCE_S)
    sent: list[int] = []
    rows = 0
    waits = endpoint.link.fileno() is not None  # within this process an answer is there at once
    while (now := time.monotonic()) < begin + (patience_s if rows else longest) and (waits or len(sent) < _ASKED):
        sent.append(endpoint.tx.seq)
        endpoint.send(probe)
        again = now + patience_s / _ASKED
        while True:
            items = endpoint.poll(max(again - time.monotonic(), 0.0))
            for message in (item.message for item in items):
                if isinstance(message, Nack) and message.of_type == type_of(probe) and message.of_seq in sent:
                    asked.refused = message.reason == NackReason.BAD_STATE
                    if not asked.refused:
                        asked.odd.append(
                            f"it refuses a drive in SAFE by {client.nack_name(message.reason)}, not BAD_STATE"
                        )
                    return
                if isinstance(message, Status) and message.state in _STREAMING:
                    asked.drives = f"STATUS then says {State(message.state).name}"
                    return
                rows += len(message.codes) if isinstance(message, Sense) else 0
            if time.monotonic() >= again or (not items and not waits):
                break
    if rows:
        asked.drives = "it takes a drive and streams"
    else:
        asked.odd.append("it does not refuse a drive in SAFE, so that only its STATUS says that it stopped")


def _is_trim(register: str) -> bool:
    return SPEC.registers[register].optional == "TRIM"


def _read_trims(endpoint: Endpoint, registers: Mapping[str, float], patience_s: float, asked: Asked) -> None:
    """Whether the trim outputs are at 0, as in SAFE; one that does not say so counts as one that is not."""
    for name in filter(_is_trim, registers):
        try:
            held = client.read_register(endpoint, name, patience_s)
        except client.Refused as refusal:
            asked.drives = (
                f"it refuses to read {name} ({client.nack_name(refusal.reason)}), whose electrode may be charged"
            )
            return
        except LinkError:
            asked.drives = f"it does not say that {name} is at 0, whose electrode may be charged"
            return
        if held:
            asked.drives = f"{name} is at code {held:g}, its electrode is charged"
            return


def _read(endpoint: Endpoint, registers: Mapping[str, float], patience_s: float, asked: Asked) -> None:
    """Whether the registers hold what was written, and SESSION may be written, which only a stopped board takes."""
    for name, written in registers.items():
        try:
            held = client.read_register(endpoint, name, patience_s)
        except client.Refused as refusal:
            asked.odd.append(f"it refuses to read {name} in SAFE: {client.nack_name(refusal.reason)}")
            continue
        except LinkError:
            asked.odd.append(f"it does not answer in SAFE, asked for {name}")
            return
        if held != written:
            asked.odd.append(differs(name, held, written))
    if "SESSION" not in registers:
        return
    try:
        client.write_register(endpoint, "SESSION", registers["SESSION"], patience_s)
    except client.Refused as refusal:
        if refusal.reason == NackReason.BAD_STATE:
            asked.drives = "it refuses SESSION, as only a board does that is armed"
        else:
            asked.odd.append(f"it refuses SESSION in SAFE: {client.nack_name(refusal.reason)}")
    except LinkError:
        asked.odd.append("it does not answer in SAFE, told SESSION")


def differs(name: str, held: float, written: float) -> str:
    """What it means that a register no longer holds what was written, as far as that tells."""
    told = f"{name} reads {held:.10g}, {written:.10g} was written"
    if name == "SESSION" and held == SPEC.registers["SESSION"].default:
        return f"the board restarted: {told}"
    return f"the board restarted, or another host wrote it: {told}"
