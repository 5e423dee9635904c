"""What a run has to say of the safety of its board: each stop, whether it latched, and whether SAFE was confirmed.

`Safety.told` is `outcome["safety"]`, which `hil.verdict.safety` judges.
"""

from dataclasses import asdict, dataclass, field
from typing import Any

from hil.wire.messages import SafeReason

LATCHING = (SafeReason.HOST_REQUEST, SafeReason.INTERRUPTED, SafeReason.RESIDUAL, SafeReason.FAULT)

CUT_THE_SUPPLY = "cut the supply of the board"


def reason_name(number: int) -> str:
    """A reason of STATUS by its name in the spec."""
    return next((member.name for member in SafeReason if member == number), f"reason {number}, which is not listed")


@dataclass
class Stop:
    """One time the board stopped before the run was over.

    `by` is board, host or another node; `account` says by what this host accounts for it, "" if by nothing.
    """

    reason: str
    by: str
    tick: int
    account: str = ""
    armed_again: bool = False


@dataclass
class Safety:
    """Kept up to date while a board is armed.

    Attributes:
        armed: whether a byte of ARM has left, or may have.
        taken: whether the board has said that it is armed.
        stops: every stop that this host did not want, in order.
        latched: reason of the stop that ended the run, "" if none did.
        rearmed: how often the board was armed again.
        confirmed: whether the last SAFE was confirmed; None while none was asked for.
        confirmed_tick: the board's tick in the STATUS that did.
        broke: how the board broke the protocol and so ended the run, "" if it did not.
        recorder: why the record stopped, "" if it did not.
        signs: which drive acts the wrong way round, "" if none does.
        words: why SAFE was not confirmed, or what the board does in SAFE that it should not, one line.
        odd: what the board did that no board does which keeps to the page, and that ended nothing, one clause each.
    """

    armed: bool = False
    taken: bool = False
    stops: list[Stop] = field(default_factory=list)
    latched: str = ""
    rearmed: int = 0
    confirmed: bool | None = None
    confirmed_tick: int | None = None
    broke: str = ""
    recorder: str = ""
    signs: str = ""
    words: str = ""
    odd: list[str] = field(default_factory=list)

    @property
    def told(self) -> dict[str, Any]:
        return asdict(self)

    @property
    def alarm(self) -> str:
        """The line that comes before everything else, "" where SAFE was confirmed or not needed."""
        return alarm_of(self.told)


def alarm_of(safety: dict[str, Any]) -> str:
    """As `Safety.alarm`, from what was told."""
    if not safety.get("armed") or safety.get("confirmed") is not False:
        return ""
    return f"SAFE was not confirmed: {CUT_THE_SUPPLY}; {safety.get('words', '')}".rstrip("; ")
