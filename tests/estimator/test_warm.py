"""The cache of compiled kernels: filled by one command, hit by every process after it."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numba
import pytest
from numba.core.caching import IndexDataCacheFile

from estimator import compiling
from estimator import warm as warming
from estimator.kernel.compiled import is_warm
from estimator.warm import KERNELS

FIRST_USE = """
import numpy as np
from estimator.observer import Observer
from estimator.settings import ControllerSettings, Device, Gain, ObserverSettings

control = ControllerSettings(latency=1, force_quantum=1e-3, force_limit=10.0, sense_quantum=1e-5)
two = Device(4000.0, (1.6e6, 1.6e6, 0.0), (1.0, 1.0, 0.0), 1e-4, (-890.0, -890.0), (1e-4, 1e-4))
one = Device(4000.0, (1.6e6,), (1.0,), 1e-4, (-890.0,), (1e-4,), drive_gain=2.0)
for gain in Gain:
    observer = Observer(two, ObserverSettings(gain=gain, memory=0.01), control)
    observer.tick(1, 2, 3, 4)
    observer.run(np.zeros((3, 2)), np.zeros((3, 2, 8)), every=2)
    observer.run(np.zeros((3, 2)), np.zeros((3, 2)), truth=np.zeros((3, 13)))
step = np.array([1e-4, 2e-4, 3e-4])
Observer(one, ObserverSettings()).run(np.zeros((3, 1)), np.asfortranarray(np.zeros((3, 1))), step=step)
"""


def python(*arguments: str, **environment: str) -> str:
    done = subprocess.run(
        [sys.executable, *arguments],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=True,
        timeout=300,
    )
    return done.stdout


@pytest.fixture(scope="module")
def warmed() -> str:
    """What warming says, where nothing may be left to compile."""
    return python("-m", "estimator.warm", "--all")


@pytest.mark.slow
def test_a_process_after_warming_compiles_nothing(warmed: str) -> None:
    assert "kernels" in warmed
    assert all(map(is_warm, KERNELS))
    assert warmed.count("\n") == 1
    log = python("-c", FIRST_USE, NUMBA_DEBUG_CACHE="1")
    assert "data loaded from" in log
    assert "saved to" not in log


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    ["effect_forces", "effect_sense", "advance", "sensed_otherwise", "correct", "predict", "command", "plain"],
)
@pytest.mark.usefixtures("warmed")
def test_a_piece_is_what_the_kernels_call(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Compiled for other types than theirs, it would stand in the cache beside it, of use to nobody."""
    compiled: list[tuple[Any, tuple[Any, ...]]] = []
    monkeypatch.setattr(compiling, "_for_types_of", lambda kernel, *given: compiled.append((kernel, given)))
    compiling.PIECES[name].compile()
    ((kernel, given),) = compiled
    (key,) = kernel._cache._cache_file._load_index()
    assert key[0] == tuple(map(numba.typeof, given))


def test_pieces_wait_for_pieces_only() -> None:
    """Each for some that begin before it, so that none waits for ever."""
    pieces = compiling.PIECES | compiling.SELDOM
    names = list(pieces)
    for number, piece in enumerate(pieces.values()):
        assert set(piece.calls) <= set(names[:number])


@pytest.mark.moderate
def test_an_index_that_many_add_to_loses_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiling, "kernel_cache", lambda: tmp_path)

    def save(key: int) -> None:
        compiling._saved_alone(IndexDataCacheFile(str(tmp_path), "kernel", "stamp"), key, f"code of {key}")

    keys = range(200)
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(save, keys))
    kept = IndexDataCacheFile(str(tmp_path), "kernel", "stamp")
    assert [kept.load(key) for key in keys] == [f"code of {key}" for key in keys]


def test_what_is_warm_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pieces of what is cold are compiled, then what is left of it is called and noted; nothing else is."""
    done: list[object] = []
    kernels = {
        name: warming.Kernels({f"piece of {name}": compiling.Piece(lambda: None)}, partial(done.append, name))
        for name in ("cold", "warm", "not asked for")
    }
    monkeypatch.setattr(warming, "KERNELS", kernels)
    monkeypatch.setattr(warming, "is_warm", lambda name: name == "warm")
    monkeypatch.setattr(warming, "mark_warm", lambda name: done.append(f"{name} noted"))
    monkeypatch.setattr(warming, "compile_side_by_side", lambda pieces: done.append(list(pieces)))
    assert warming.warm(["cold", "warm"]) == ["cold"]
    assert done == [["piece of cold"], "cold", "cold noted"]


def test_one_processor_compiles_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0})
    monkeypatch.setattr(compiling, "ProcessPoolExecutor", None)
    compiling.compile_side_by_side(compiling.PIECES)
