"""Whether every stop was confirmed, and whether one latched."""

from collections.abc import Mapping
from typing import Any

from hil.records.result import Part


def judge_safety(outcome: Mapping[str, Any]) -> Part:
    """What the loop's process says of the board's stops."""
    return Part(outcome="good" if "counters" in outcome else "unknown")
