"""mount.toml: how up to three gyros sit on one body, for `hil run X Y Z --mount`."""

from pathlib import Path
from typing import Annotated, Self

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from hil.bench.section import NotNegative, Section, as_tuple
from hil.toml.reading import parse_table, read_table

_UNIT = 1e-3  # by which the length of a unit vector may be off one, as written with four digits
_WORST = 1e3  # condition number beyond which an angle's error would be that many times larger in the attitude

Direction = Annotated[tuple[float, float, float], BeforeValidator(as_tuple)]


class MountedAxis(Section):
    """Where the sensitive axis of one gyro points: in the order of the bench files."""

    direction: Direction
    """unit vector of the sensitive axis in the body's frame, about which its reported angle is positive"""
    direction_u_rad: NotNegative = 0.0
    """standard uncertainty of that direction, the same across it both ways"""

    @model_validator(mode="after")
    def _is_a_unit_vector(self) -> Self:
        length = float(np.linalg.norm(self.direction))
        if abs(length - 1.0) > _UNIT:
            raise ValueError(f"direction: a unit vector is expected, its length is {length:.6g}; divide by that")
        return self


class Mount(Section):
    """The file: a table [[axis]] for each gyro."""

    axis: Annotated[tuple[MountedAxis, ...], BeforeValidator(as_tuple), Field(min_length=1, max_length=3)]
    """tables [[axis]]"""

    @model_validator(mode="after")
    def _axes_are_independent(self) -> Self:
        condition = float(np.linalg.cond(self.matrix))
        if not condition < _WORST:
            raise ValueError("axis: the directions lie in one plane or along one line; no attitude follows from them")
        return self

    @property
    def matrix(self) -> np.ndarray:
        """Unit vectors, a row each (axes, 3)."""
        rows = np.array([axis.direction for axis in self.axis])
        return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))

    @property
    def u_rad(self) -> np.ndarray:
        """Standard uncertainty of each direction (axes,)."""
        return np.array([axis.direction_u_rad for axis in self.axis])


def load_mount(path: Path) -> Mount:
    """The mount in a file. Raises InputError: one line with file, key and what was expected."""
    return parse_table(read_table(path), Mount, str(path))
