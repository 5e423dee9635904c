"""Who is blamed for a run on wall time that lasts too long: docs/safety.md, The host."""

import time
from types import SimpleNamespace
from typing import Any, cast

import pytest

from hil.running.loop.skeleton import HostTooSlow, Loop
from hil.wire.errors import ProtocolError


def ran_for(seconds: float, *, behind: int, turns: int, lockstep: bool = False) -> None:
    """Look at the time of a run of 4 s that may take 5 s and a timeout of 1 s; in `behind` of its `turns` the samples
    were there before the host listened.
    """
    loop = SimpleNamespace(
        _lockstep=lockstep, _begun_ns=time.monotonic_ns() - round(1e9 * seconds), _duration_s=4.0, _timeout_s=1.0,
        _limits=SimpleNamespace(overtime=0.25), _behind=behind, _turns=turns, _name="pty:a-board",
    )  # fmt: skip
    Loop._require_time(cast(Any, loop))


def test_a_host_that_samples_wait_for_blames_itself() -> None:
    with pytest.raises(HostTooSlow) as raised:
        ran_for(6.1, behind=51, turns=100)
    assert str(raised.value).endswith("this host is too slow: samples were waiting in 51\u00a0% of the loop iterations")
    assert "the run of 4 s was not over after 6 s, [limits] overtime is 0.25" in str(raised.value)
    assert "board" not in str(raised.value)


def test_a_host_that_waits_for_samples_does_not() -> None:
    with pytest.raises(ProtocolError, match=r"pty:a-board: .*; the board's ticks, or the way from it, are too slow"):
        ran_for(6.1, behind=50, turns=100)


@pytest.mark.parametrize(("seconds", "lockstep"), [(5.9, False), (1000.0, True)])
def test_neither_is_blamed_in_time_or_in_lockstep(seconds: float, lockstep: bool) -> None:
    ran_for(seconds, behind=100, turns=100, lockstep=lockstep)
