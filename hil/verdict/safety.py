"""Whether every stop was confirmed, and whether one latched."""

from collections.abc import Mapping
from typing import Any

from hil.records.result import Part

_CUT = "cut the supply of the board before you touch it or start another run"
_FIRMWARE = "correct the board's firmware: docs/wire.md, What a board does"
_CAUSE = {
    "FAULT": "find what made the board's protection trip; only the board lifts a FAULT",
    "WATCHDOG": "measure the way to the board: hil doctor --link …",
    "LINK_LOST": "measure the way to the board: hil doctor --link …",
}


def judge_safety(outcome: Mapping[str, Any]) -> Part:
    """What the loop's process, or its supervisor, says of the board's stops (`Safety.told`)."""
    safety: Mapping[str, Any] | None = outcome.get("safety")
    if safety is None or not safety["armed"]:
        return Part(outcome="unknown")
    stopped, cure = str(outcome.get("stopped", "")), outcome.get("cure")
    if safety["confirmed"] is False:
        before = _latched(safety, stopped)
        words = safety["words"] + (f"; {before}" if before and before not in safety["words"] else "")
        return Part(outcome="unsafe", reason=f"SAFE was not confirmed: cut the supply of the board; {words}", next=_CUT)
    if safety["latched"]:
        cause = _CAUSE.get(safety["latched"], "ask who, or what, stopped it")
        return Part(outcome="failed", reason=_latched(safety, stopped), next=cure or cause)
    if safety["broke"]:
        unknown = "check the board: its supply, its link, its firmware"
        return Part(outcome="failed", reason=stopped, next=cure or unknown)
    if odd := safety.get("odd"):
        return Part(outcome="failed", reason=f"{'; '.join(odd)}", next=_FIRMWARE)
    if safety["recorder"]:
        reason = stopped or f"the record ended: {safety['recorder']}"
        return Part(outcome="failed", reason=reason, next="see to the disk and start again")
    if safety["signs"]:
        reason = stopped if safety["signs"] in stopped else safety["signs"]
        return Part(
            outcome="failed", reason=reason, next="change the sign in the bench file, or swap the wires, and run again"
        )
    if safety["confirmed"] is None:
        return Part(outcome="failed", reason=stopped or safety["words"])
    if safety["words"]:
        return Part(outcome="good", reason=f"SAFE was confirmed, yet {safety['words']}", next=_FIRMWARE)
    return Part(outcome="good", reason="SAFE was confirmed")


def remarks(outcome: Mapping[str, Any]) -> list[str]:
    """Stops that were accounted for and did not end the run, and what the board does in SAFE, one line each."""
    safety: Mapping[str, Any] = outcome.get("safety") or {}
    told = [
        f"{stop['reason']} at tick {stop['tick']}, accounted for ({stop['account']}); the board was armed again"
        for stop in safety.get("stops", ())
        if stop["armed_again"]
    ]
    if safety.get("confirmed") and safety["words"]:
        told.append(str(safety["words"]))
    return told


def _latched(safety: Mapping[str, Any], stopped: str) -> str:
    """The stop that latched, in the words of the run's end where it was that."""
    if not safety["latched"] or safety["latched"] in stopped or not safety["stops"]:
        return stopped
    stop = safety["stops"][-1]
    if stop["by"] == "host":
        return stopped
    told = f"the board had stopped: {stop['reason']} at tick {stop['tick']}"
    return f"{stopped}; {told}" if stopped else told
