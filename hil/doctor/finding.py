"""One thing the doctor looked at."""

from typing import Literal, NamedTuple

State = Literal["good", "missing", "bad"]


class Finding(NamedTuple):
    """`missing` costs something that can be had; `bad` stops the link that was asked for. `remedy` is one line."""

    subject: str
    state: State
    told: str
    remedy: str = ""
