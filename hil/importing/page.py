"""The reference page of maps, written from what reads them: `python -m hil.importing.page`."""

from types import UnionType
from typing import Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from hil.importing.mapping import Addend, Columns, Filter, RecordMap, Source, Time
from hil.importing.units import MOTIONS, NAMES, UNITS, VOLTS_OF_LEVELS

_CHANNELS = {
    "t_s": "time",
    "vx_V": "what the sensor of x shows, in volts",
    "vy_V": "the same of y",
    "vx": "what the sensor of x shows, in a unit of its own: any word of up to 16 letters, kept as it is",
    "vy": "the same of y",
    "base": "motion of the base of a single axis, which is its drive",
    "ux_mps2": "drive of x, force per unit mass",
    "ux_N": "drive of x, force",
    "ux_V": "drive of x, voltage",
    "uy_mps2": "drive of y, force per unit mass",
    "uy_N": "drive of y, force",
    "uy_V": "drive of y, voltage",
    "rate_rad_s": "reference for the rate",
    "temp_C": "temperature",
}

_INTRODUCTION = """\
# Maps

A map tells `hil import FILE --map MAP` how a file that was written elsewhere becomes a record: which column is what, in
which unit, and what was done to it. TOML, UTF-8; unknown keys are errors, with the nearest one that is known. The file
is delimited text, plain or gzipped, MATLAB before 7.3, or Parquet. Arrays of a program take the same maps,
`hil.trace(arrays, bench, mapping=MAP)`. Generated: `python -m hil.importing.page`.

A file whose columns are already called `t_s, vx_V, vy_V, ux_mps2, uy_mps2` (or `_V`, `_N`), with `rate_rad_s`, `temp_C`
where there are any and without y of a single axis, needs no map. A map without `[columns]` keeps these names, and says
the rest, as `delimiter = ";"`.

```toml
# beam.map.toml: a beam on a shaker, filmed; the shaker's displacement beside it
hold = "bandlimited"
delimiter = ";"
covariates = { load_kg = 0.25 }

[columns]
t_s = { column = "time", unit = "ms" }
vx = { column = "tip", unit = "px", offset = -512.0 }
base = { column = "shaker", unit = "mm" }

[filter]
low_Hz = 2.0
high_Hz = 60.0
decimate = 4

[segments]
train = [0, 6000]
test = [6000, 10000]
```

    hil import beam.csv --map beam.map.toml          an example's name will do as well: --map silverbox
    hil trace beam.arrow --bench beam.bench.toml

The bench file says what the map leaves open, and the two must agree: `[device] axes` and `sample_rate_Hz` (behind the
filter), `[device.drive] unit`, and `[device.sense] unit`, `senses` and `gain_V_per_m`. The last three say in which unit
the sensor shows what, and how much of it for a metre, for 1 m/s or 1 m/s² ([bench file](bench.md)). With
`unit = "px"` a volt in the names of its keys is a pixel.
"""

_KINDS = """
The keys from `encoding` to `units_row` say how a text is written. A MATLAB file, a Parquet file or arrays beside one of
them are refused, as the key could not act; all other keys act on every kind.

**Text.** A line is a row. A quote that does not close on its line is refused, with the line; so is a row that has more
cells than the header, unless they are empty. A row may end early where nothing is mapped. Numbers have digits, sign,
point and exponent: `1_234` is none. The exponent may have the D of Fortran where there is a point, as `1.5D-03`. Where
a column has whole numbers of up to three digits, and else numbers with exactly three digits behind the point, as
`-1.319`, the point may stand between thousands: `decimal = "."`, or `thousands = "."` of the column, says which. A
byte order mark (UTF-8, UTF-16) needs no `encoding`.

**MATLAB.** `column` is a name as MATLAB writes it: `t`, `imu.gyro(:,3)`, `log.signals.values(:,2)`, `runs(2).x`.
A file that has not all bytes that it declares is refused.

**Files** are regular ones: a pipe or a device is refused. A line of more than 4 MB, and beyond 256 MB a gzipped text of
more than 200 times its size, are as well.

**Parquet.** `column` is a name, of a struct `imu.gyro`, or a position among the columns, of which a struct is one.
Only columns that are asked for are read;
without a map those that are no channels are left out, and told.
"""

_MISSING = """
**No measurement.** Without `missing`, a number that instruments write in place of one is refused, with its row: any
beyond ±1e30 (9.9E37, 9.91E37), and −999, 9999, −999.25 and their like where it lies apart, more than 10 times the
range of all other values from the nearest. A single true value so far apart, a whole number below 10,000, is refused
twice in 10,000 times. `missing = [9.9e37, -999, "OVER", "nan"]` takes rows in which a mapped column reads so as lost:
samples that are missing, over which observer and trace pass. `"nan"` stands for what is empty in Parquet as well, `""`
for an empty cell of a text. A code that the list lacks is refused all the same, −9.9E37 beside `missing = [9.9e37]`;
`missing = []` says that every number was measured.
"""

_TIME = """
**Time** in `t_s` is a number in its unit, of any size: whole numbers are subtracted before they are rounded, so that
nanoseconds since 1970 are exact. `unit = "iso"` takes text of ISO 8601 (dates with or without a zone, times of a
day), and columns whose type is a date or a length of time. A date counts from the first row. So does a number so large
that a float could not tell its steps to a millionth, as seconds since 1970 at 100 Hz: `t_s` starts at 0, and the import
says which time that is in the file. Where the time stands in two columns, `add` sums them:

```toml
hold = "zoh"
[columns]
t_s = { column = "GPSSecond", unit = "s", add = [{ column = "GPSWeek", unit = "week" }] }
vx = { column = "GyroZ", unit = "dps" }
```

Stamps that were rounded (a millisecond at 400 Hz, single precision) are no uneven time. Where rounding is below a
hundredth of a step it is passed over. Beyond that the import names the rate that fits all stamps:
`sampling_rate_Hz = 400.0` beside `t_s` takes it, and the stamps say which sample each row is, so that a gap stays one.
A stamp that stands twice is a row written twice, and is refused with its row, unless there is more than one sample to
a stamp. Only what no rate fits asks for `--nonuniform`. Where it is given and a rate fits, the rate is taken and told.
Uneven stamps that are rounded to more than a hundredth of a step are told as well, as no interval accounts for that.
"""

_COLUMN = """
value = (`scale` · cell + `offset`) in `unit`: `scale` comes first, so that `offset` is in the unit. Degrees of a
reference angle are no channel: what is compared is the rate, `rate_rad_s`; differentiate an angle before the import,
positive about the axis that leads from x to y.
"""

_UNITS = """
`vx_V` and `vy_V` take the levels `dBV`, `dBmV`, `dBuV` as well, and have the amplitude. A code (LSB) of a
channel in SI is no unit: `scale = 0.00875, unit = "dps"` says what one is. Further units go through `scale`:
kilonewtons are `unit = "N", scale = 1e3`. Both letters that look like µ are one. A conversion to what is no finite
number is refused with its row. A `base` takes those of a motion, and its unit says what is given:
"""

_BASE = """
Beside its base a mass feels minus the base's acceleration as a force per unit mass: the record's drive is that, in
m/s² (`[device.drive] unit = "mps2"`). Displacement and velocity are differentiated by a spline of degree 7 through the
samples; noise in them grows with the square of the frequency, so give a filter with them. A sensor that stands beside
the base, as a laser vibrometer does, sees the base as well: `frame = "absolute"`, with a unit of motion, takes it off.
`hold = "zoh"` has no meaning for a base. [Why so](../decisions/0022-records-from-elsewhere.md).
"""

_HOLD = """
| `hold` | the drive's value in row m |
|---|---|
| `"zoh"` | acted over the whole interval that ends at t_m: a converter that holds |
| `"foh"` | is that at t_m; straight lines between |
| `"bandlimited"` | is that at t_m; what a recorder behind an anti-alias filter saw, smooth between |

`hil import --hold` overrides it, and without a map it is `"zoh"`; a free response has no drive, and `"zoh"` will do.
With `"zoh"` the first row's drive acted before the record began: 0 will do where it is not known.
"""

_FILTER = """
Runs forwards and backwards, so that nothing is late, on sense and drive alike; reference rate and temperature are only
decimated. With `decimate` a further filter of 80 dB keeps what is below 0.4 of the new rate, and nothing folds; an edge
beyond that is refused. Both ends, where the filter has not settled, are left out, and segments move with their rows.
The noise that is left is computed and told in the diagnosis; `[device.sense] noise_V` stays that of a sample of the
file. Needs even time, and no drive that is held. Keep the third harmonic in the band where a spring that stiffens is
looked for: two modes of one record are imported twice, each with its own band.
"""

_ENVELOPE = """
## An amplitude instead of a waveform

A ring-down is often kept as its amplitude over time, in dB of the instrument's reference. That is a channel in a unit
of its own, and the bench file says what it is:

```toml
# reed.map.toml
hold = "zoh"
[columns]
t_s = { column = "time", unit = "ms" }
vx = { column = "level", unit = "dB" }
```

```toml
# reed.bench.toml
[device.sense]
senses = "envelope"
unit = "dB"            # or another level: dBV, dBuV, dBm; or that of the amplitude itself: mm, V
gain_V_per_m = 1e6     # how many of what 0 dB is, for a metre
noise_V = 0.05         # of a sample, in dB
```

`sample_rate_Hz` is that of the amplitude, and may be far below the resonance. `hil trace` names the law of damping;
frequencies stay as declared, and no filter, drive or second axis goes with it ([how](../decisions/0028-envelope.md)).
"""

_SEGMENTS = """
Rows [first, one past the last], counted from 0 among those that `where` keeps, before any filter; within `rows`, where
that is given. `train` and a segment that begins where it ends split the record for `hil trace`; the others are names.
"""

_ERRORS = """
## When it does not fit

| the file | key |
|---|---|
| is read as one cell a line | `delimiter = ";"`, `"\\t"`, or `" "` for runs of blanks: the message names what it saw |
| has lines before its header | `skip_lines = 3`, or `comment = "%"` where they begin so |
| has a line of units below its header | `units_row = true`; refused where that line holds numbers |
| has its header again within | `comment = "Time/ms"` as the header begins, `header = false`, and positions |
| has two columns of one name | `column = 3`, its position |
| has a quote that is a letter | `quote = ""` |
| is not UTF-8 | `encoding = "cp1252"`, or `"utf-16"` |
| has the time in two columns | `add` of `t_s` |
| has dates for a time | `unit = "iso"` of `t_s` |
| has stamps of few digits | `sampling_rate_Hz = 400.0` beside `t_s` |
| has 9.9E37 or −999 for no measurement | `missing = [9.9e37, -999]` |
| has no header | `header = false`, and columns by position from 1 |
| has no time | `sampling_rate_Hz = 1000.0` |
| has uneven time | none: `hil import --nonuniform`, each step with its own length |
| lacks samples | none: `hil import --nonuniform` counts them; over a gap the drive is unknown, and nothing judged |
| is in one table with others | `where = { sensor = "CRS03" }` |
| holds a table of steady states | `steady = true`, no time; for rate sensors |
| needs other numbers | `scale`, `offset` of a column |
| has a decimal comma | `decimal = ","`, and another `delimiter` |
| has points, blanks or ’ between thousands | `thousands = "."` of a column |
"""


def page() -> str:
    """The whole page in Markdown."""
    parts = [
        _INTRODUCTION,
        "\n## Keys\n",
        _keys(RecordMap, skip=("columns", "segments", "filter")),
        _KINDS,
        _MISSING,
        _HOLD,
    ]
    parts += ["\n## [columns]\n", "\nA table for each channel that the record has; x and y in one unit.\n"]
    parts += ["\n| channel | is | unit |\n|---|---|---|\n"]
    parts += [f"| `{name}` | {_CHANNELS[name]} | {_units_of(name)} |\n" for name in Columns.model_fields]
    parts += ["\n", _keys(Source), _COLUMN, "\nOf `t_s` also:\n", _keys(Time, skip=tuple(Source.model_fields)), _TIME]
    parts += ["\nA column of `add`:\n", _keys(Addend), _UNITS, "\n| unit | base and `frame` take it as |\n|---|---|\n"]
    for order, what in enumerate(NAMES):
        units = ", ".join(f"`{unit}`" for unit, motion in MOTIONS.items() if motion.order == order)
        parts.append(f"| {units} | {what} |\n")
    parts += [_BASE, "\n## [filter]\n\n", _keys(Filter), _FILTER, "\n## [segments]\n", _SEGMENTS, _ENVELOPE, _ERRORS]
    return "".join(parts)


def _keys(model: type[BaseModel], skip: tuple[str, ...] = ()) -> str:
    lines = ["\n| key | value | default | meaning |\n", "|---|---|---|---|\n"]
    for name, field in model.model_fields.items():
        if name not in skip:
            lines.append(f"| `{name}` | {_kind(field.annotation)} | {_default(field)} | {field.description} |\n")
    return "".join(lines)


def _units_of(channel: str) -> str:
    if channel in ("vx", "vy"):
        return "any"
    if channel in ("vx_V", "vy_V"):
        return ", ".join(f"`{unit}`" for unit in (*UNITS["V"], *VOLTS_OF_LEVELS))
    if channel == "base":
        return "see below"
    return ", ".join(f"`{unit}`" for unit in UNITS[channel.split("_", 1)[1]])


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "**required**"
    value = field.get_default(call_default_factory=True)
    if value is None or value in ({}, ()):
        return "–"
    return f"`{str(value).lower() if isinstance(value, bool) else repr(value)}`".replace("'", '"')


def _kind(annotation: object) -> str:
    """What a key takes, in words."""
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin is Literal:
        return " · ".join(f'`"{each}"`' for each in inner)
    if origin in (Union, UnionType):
        return " or ".join(_kind(each) for each in inner if each is not type(None))
    if origin is tuple:
        if len(inner) == 2 and inner[1] is Ellipsis:
            return "list of tables" if inner[0] is Addend else f"list of {_kind(inner[0])}"
        return "two whole numbers"
    if origin is dict:
        return "table of texts" if inner[1] is str else "table of numbers"
    if origin is not None and inner:  # Annotated
        return _kind(inner[0])
    words = {"str": "text", "float": "number", "int": "whole number", "bool": "true, false"}
    return words[getattr(annotation, "__name__", "")]


if __name__ == "__main__":
    print(page(), end="")
