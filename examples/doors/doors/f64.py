"""Files of doubles, most significant byte last, three to a row: time in s, response in V, drive in m/s²."""

from pathlib import Path

import numpy as np
import numpy.typing as npt

_NAMES = ("t_s", "vx_V", "ux_mps2")


def columns(path: Path) -> dict[str, npt.ArrayLike]:
    """The columns (n,) by name. Raises ValueError for a file that ends within a row."""
    values = np.fromfile(path, "<f8")
    if values.size * 8 != path.stat().st_size or values.size % 3:
        raise ValueError(f"ends within a row, at byte {path.stat().st_size}")
    return dict(zip(_NAMES, values.reshape(-1, 3).T, strict=True))
