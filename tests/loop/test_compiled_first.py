"""What a run needs and the cache does not have is compiled before the board is armed, and the run says so."""

from typing import Any

import pytest

from estimator.kernel.compiled import COMMON, GAIN_MODE, STATIONARY
from hil.bench import load_bench
from hil.examples import find
from hil.loop import worker


@pytest.mark.parametrize(
    ("asked", "cold", "compiled"),
    [
        ({}, set(), []),
        ({}, {GAIN_MODE, STATIONARY}, []),
        ({}, {COMMON, GAIN_MODE}, [COMMON]),
        (
            {"loop": {"mode": "gain", "estimate_every": 50}, "link": {"watchdog_s": 0.5}},
            {GAIN_MODE, STATIONARY},
            [GAIN_MODE],
        ),
        ({"observer": {"gain": "stationary"}}, {COMMON, GAIN_MODE, STATIONARY}, [COMMON, STATIONARY]),
    ],
)
def test_what_is_compiled_is_what_this_run_needs(
    asked: dict[str, Any], cold: set[str], compiled: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[str] = []
    done: list[str] = []
    monkeypatch.setattr("estimator.kernel.compiled.is_warm", lambda kernels: kernels not in cold)
    monkeypatch.setattr("estimator.warm.warm", done.extend)
    bench = load_bench(find("bench", "s-slow")).with_(**asked)
    worker._have_compiled(bench, lambda **said: told.append(said["note"]))
    assert done == compiled
    assert len(told) == bool(compiled)
    assert all(name in told[0] for name in compiled)
