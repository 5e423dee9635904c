"""Columns over one time base, as NumPy arrays with their units."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from hil.errors import InputError
from hil.numbers import COVERAGE
from hil.records.units import symbol_of

if TYPE_CHECKING:
    import pandas
    import pyarrow

Floats = npt.NDArray[np.float64]
_DEGREES = {"_rad_s": ("_dps", "°/s"), "_rad": ("_deg", "°")}  # end of a column: its end and unit in degrees


@dataclass(frozen=True, eq=False)
class Series:
    """Named columns, (n,) each, over the bench time `t_s` (n,) in seconds.

    units: by column, "" where it is a number; header: what else is to be known of them, for `to_arrow`.

    >>> x = Series(np.array([0.0, 0.5]), {"x_m": np.array([1.0, 2.0])}, {"x_m": "m"})
    >>> x.values, x.unit, len(x.since(0.2))
    (array([1., 2.]), 'm', 1)
    >>> x
    <Series 0 … 0.5 s, 2 rows: x_m [m]>
    """

    t_s: Floats
    _columns: Mapping[str, npt.NDArray[Any]]
    units: Mapping[str, str]
    header: Mapping[str, str] = field(default_factory=dict)

    def __len__(self) -> int:
        return int(self.t_s.size)

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __contains__(self, name: object) -> bool:
        return name in self._columns

    def __getitem__(self, name: str) -> npt.NDArray[Any]:
        """The column called `name`, (n,). Raises InputError with the names there are."""
        if name not in self._columns:
            raise InputError(f"{name}: no such column; there are {', '.join(self._columns)}")
        return self._columns[name]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> npt.NDArray[Any]:
        values = np.asarray(self.values, dtype=dtype)
        return values.copy() if copy else values

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns, in their order; `series[name]` is the array of one."""
        return tuple(self._columns)

    @property
    def values(self) -> npt.NDArray[Any]:
        """The first column, which is the quantity itself, (n,)."""
        return next(iter(self._columns.values()))

    @property
    def u(self) -> npt.NDArray[Any]:
        """Standard uncertainty (k = 1) of `values`, (n,): of a state what the observer says, of an angle all sources.

        Raises InputError where nothing says one.

        >>> Series(np.zeros(1), {"angle_rad": np.ones(1), "angle_u_rad": np.full(1, 0.1)}, {}).u
        array([0.1])
        """
        name = next(iter(self._columns))
        for column in (f"sd_{name}", f"{symbol_of(name)}_u{name.removeprefix(symbol_of(name))}"):
            if column in self._columns:
                return self._columns[column]
        raise InputError(f"{name}: nothing says how uncertain it is; there are {', '.join(self._columns)}")

    @property
    def expanded(self) -> npt.NDArray[Any]:
        """Expanded uncertainty U (k = 2) of `values`, (n,). Raises InputError as `u` does."""
        return np.asarray(COVERAGE * self.u)

    @property
    def unit(self) -> str:
        """Unit of `values`."""
        return self.units[next(iter(self._columns))]

    def in_degrees(self) -> "Series":
        """The same with every column in rad, rad/s or their like in degrees: angle_rad as angle_deg, rate_rad_s as
        rate_dps; other columns as they are.

        >>> Series(np.array([0.0]), {"angle_rad": np.array([np.pi])}, {"angle_rad": "rad"}).in_degrees()["angle_deg"]
        array([180.])
        """
        columns, units = {}, {}
        for name, values in self._columns.items():
            end = next((end for end in _DEGREES if name.endswith(end)), None)
            other = name if end is None else name.removesuffix(end) + _DEGREES[end][0]
            columns[other] = values if end is None else np.degrees(values)
            units[other] = self.units[name] if end is None else _DEGREES[end][1]
        return Series(self.t_s, columns, units, self.header)

    def since(self, t_s: float) -> "Series":
        """The part from that bench time on."""
        first = int(np.searchsorted(self.t_s, t_s))
        return Series(self.t_s[first:], {n: v[first:] for n, v in self._columns.items()}, self.units, self.header)

    def to_arrow(self) -> "pyarrow.Table":
        """A table with t_s and the columns; units in the metadata of each field, the header in that of the table."""
        import pyarrow as pa

        arrays = {"t_s": self.t_s, **self._columns}
        units = {"t_s": "s", **self.units}
        fields = [pa.field(n, pa.array(v[:0]).type, metadata={"unit": units[n]}) for n, v in arrays.items()]
        return pa.table(list(arrays.values()), schema=pa.schema(fields, metadata=dict(self.header)))

    def to_pandas(self) -> "pandas.DataFrame":
        """A frame over t_s. Raises InputError where pandas is not installed."""
        try:
            import pandas as pd
        except ImportError:
            raise InputError("to_pandas: pandas is not installed; pip install pandas, or use to_arrow") from None
        return pd.DataFrame(dict(self._columns), index=pd.Index(self.t_s, name="t_s"))

    def __repr__(self) -> str:
        named = ", ".join(f"{name} [{self.units[name]}]" if self.units[name] else name for name in self._columns)
        span = f"{self.t_s[0]:g} … {self.t_s[-1]:g} s" if len(self) else "empty"
        return f"<Series {span}, {len(self)} rows: {named}>"
