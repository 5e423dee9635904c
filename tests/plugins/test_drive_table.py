"""A table of drives as a plug-in: played row by row, within its limits, refused where it is none."""

from pathlib import Path

import numpy as np
import pytest

from hil.bench import load_bench, override
from hil.bench.examples import find
from hil.errors import InputError
from hil.library.generating import assumed_board
from hil.plugins.of_bench import loop_observer
from hil.plugins.plugged import Plugged


def table(folder: Path, **changed: object) -> Path:
    """Ten rows on x, then ten on y; a limit that only larger voltages exceed."""
    forces = np.zeros((20, 2))
    forces[:10, 0], forces[10:, 1] = 1.0, -0.5
    arrays: dict[str, object] = {"forces": forces, "pieces": np.repeat([0, 1], 10), "limit_V": np.full(2, 0.1)}
    place = folder / "mine.npz"
    np.savez(place, **{name: value for name, value in (arrays | changed).items() if value is not None})  # type: ignore[arg-type]
    return place


def played(place: Path, volts: list[float]) -> list[tuple[float, float]]:
    """Forces in m/s² that answer these sense voltages on x."""
    name = str(place)
    bench = override(
        load_bench(find("bench", "s-slow")),
        {"observer": {"plugin": name}, "controller": {"plugin": name}, "loop": {"clock": "lockstep"}},
        "the test",
    )
    identity = assumed_board(bench, 1, None, None)
    observer = loop_observer(bench, identity)
    assert isinstance(observer, Plugged)
    observer.enable_control(True)
    told = []
    for volt in volts:
        ux, uy = observer.tick(volt / identity.sense_scale_V, 0.0, 0.0, 0.0)
        told.append((ux * identity.drive_scale_mps2, uy * identity.drive_scale_mps2))
    observer.close()
    return told


def test_it_is_played_row_by_row_and_then_rests(tmp_path: Path) -> None:
    forces = played(table(tmp_path), [0.0] * 24)
    assert np.allclose(forces[:10], (1.0, 0.0), atol=1e-3)
    assert np.allclose(forces[10:20], (0.0, -0.5), atol=1e-3)
    assert forces[20:] == [(0.0, 0.0)] * 4


def test_a_voltage_beyond_the_limit_ends_the_piece_and_not_the_next(tmp_path: Path) -> None:
    forces = played(table(tmp_path), [0.0] * 4 + [-0.11] + [0.0] * 15)
    assert np.allclose(forces[:4], (1.0, 0.0), atol=1e-3)
    assert forces[4:10] == [(0.0, 0.0)] * 6
    assert np.allclose(forces[10:20], (0.0, -0.5), atol=1e-3)


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"forces": np.zeros((20, 3))}, "expected forces"),
        ({"forces": np.full((20, 2), np.nan)}, "finite"),
        ({"forces": np.full((20, 2), 1e6)}, "the limit is"),
        ({"limit_V": np.zeros(2)}, "above 0"),
        ({"pieces": None}, "no array"),
    ],
)
def test_what_is_no_table_is_refused_in_one_line(tmp_path: Path, changed: dict[str, object], told: str) -> None:
    with pytest.raises(InputError, match=told) as refusal:
        played(table(tmp_path, **changed), [0.0])
    assert "\n" not in str(refusal.value)


def test_another_file_is_refused(tmp_path: Path) -> None:
    place = tmp_path / "other.npz"
    place.write_bytes(b"PK no archive")
    with pytest.raises(InputError, match=r"no table of drives"):
        played(place, [0.0])
