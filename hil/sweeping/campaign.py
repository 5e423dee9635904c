"""A campaign file: which scenario and bench, which keys of theirs take which values, what is looked at in each run."""

from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from hil.bench.data_sheet import BY_NAME
from hil.bench.loop import RunName
from hil.bench.section import Section, as_tuple
from hil.options import chosen, with_fields
from hil.running.options import OF_THE_LOOP, RunOptions
from hil.sweeping.instrument import Chamber, Instrument, Table
from hil.toml.reading import parse_table, read_table
from hil.tracing.options import TraceOptions

Value = float | int | bool | str
Seed = Annotated[int, Field(ge=0, le=2**63 - 1)]
Texts = Annotated[tuple[str, ...], BeforeValidator(as_tuple)]
Values = Annotated[tuple[Any, ...], BeforeValidator(as_tuple), Field(min_length=1)]

MOST_RUNS = 10_000_000


class Design(Section):
    """Which points are taken of all that the varied keys span."""

    kind: Literal["grid", "latin_hypercube", "sobol"] = "grid"
    """grid: every combination of the levels; latin_hypercube, sobol: `points` of them, spread evenly (SciPy's)"""
    points: Annotated[int, Field(ge=1, le=MOST_RUNS)] | None = None
    """how many; of a grid none is given, of sobol it is a power of two"""

    @model_validator(mode="after")
    def _points_belong(self) -> Self:
        if self.kind == "grid" and self.points is not None:
            raise ValueError("points: a grid has as many as its levels make; leave it out, or give another kind")
        if self.kind != "grid" and self.points is None:
            raise ValueError(f'points: missing; expected: how many points of the "{self.kind}"')
        if self.kind == "sobol" and self.points is not None and self.points & (self.points - 1):
            below = 1 << (self.points.bit_length() - 1)
            raise ValueError(f"points: {self.points} is no power of two; give {below} or {2 * below}")
        return self


class Vary(Section):
    """A key that takes other values from point to point: listed ones, a range, or scatter about a mean."""

    key: str
    """`scenario.` or `bench.` and the key's place in that file: scenario.sense.noise_V,
    scenario.truth.stiffness_N_per_m[0], bench.observer.memory_s"""
    name: str | None = None
    """of its column in the results; without it the last part of the key"""
    also: Texts = ()
    """other keys that take the same value"""
    values: Values | None = None
    """the values, of one sort: numbers, texts, true and false, or lists"""
    low: float | None = None
    """least value of a range"""
    high: float | None = None
    """largest value of a range"""
    levels: Annotated[int, Field(ge=2)] | None = None
    """of a grid: how many values of the range, ends included"""
    scale: Literal["linear", "log"] = "linear"
    """log: the range is evenly filled in the logarithm"""
    mean: float | None = None
    """of a normal distribution"""
    sd: Annotated[float, Field(gt=0)] | None = None
    """its standard deviation"""
    relative: bool = False
    """true: what is drawn multiplies the number that the file has at the key"""

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        ranged, normal = (self.low, self.high), (self.mean, self.sd)
        kinds = [self.values is not None, any(v is not None for v in ranged), any(v is not None for v in normal)]
        if sum(kinds) != 1:
            raise ValueError(f"key: {self.key} takes either values, or low and high, or mean and sd; give one of these")
        if kinds[1]:
            if self.low is None or self.high is None or not self.low < self.high:
                raise ValueError(f"low: {self.key}: expected low below high, both given")
            if self.scale == "log" and self.low <= 0.0:
                raise ValueError(f"low: {self.key}: {self.low:g} has no logarithm; give one above 0")
        if kinds[2] and (self.mean is None or self.sd is None):
            raise ValueError(f"mean: {self.key}: expected mean and sd, both given")
        if self.levels is not None and not kinds[1]:
            raise ValueError(f"levels: {self.key}: belongs to low and high; leave it out")
        if self.scale == "log" and not kinds[1]:
            raise ValueError(f"scale: {self.key}: belongs to low and high; leave it out")
        if self.values is not None:
            sorts = {_sort(value) for value in self.values}
            if len(sorts) > 1 or None in sorts:
                raise ValueError(f"values: {self.key}: expected values of one sort: numbers, texts, booleans or lists")
            if len({repr(value) for value in self.values}) < len(self.values):
                raise ValueError(f"values: {self.key}: a value stands there twice; seeds repeats runs")
            if self.relative and sorts != {"number"}:
                raise ValueError(f"relative: {self.key}: numbers only can multiply")
        return self

    @property
    def column(self) -> str:
        return self.name or self.key.rpartition(".")[2]

    @property
    def keys(self) -> tuple[str, ...]:
        """All keys that take its value."""
        return (self.key, *self.also)


def _sort(value: Any) -> str | None:
    if isinstance(value, bool):
        return "boolean"
    if isinstance(value, int | float):
        return "number" if value == value and abs(value) != float("inf") else None
    return "text" if isinstance(value, str) else "list" if isinstance(value, list) else None


class Each(Section):
    """What is looked at in each run beside its score."""

    drawn_initial: bool = False
    """the observer's initial values are drawn about the board's true state, with the spread that the bench declares:
    without that its covariance, and with it NEES and coverage, have nothing to be true of"""
    bound: bool = False
    """the posterior Cramér–Rao bound of rate and pattern angle along the true trajectory: how well any estimator could
    have known them"""
    scan: bool = False
    """the closing scan, and with it verdict and uncertainty as `hil run` gives them; takes about as long as the run"""
    trace: bool = False
    """a trace of the record: which effect the model lacks; takes many times as long as the run"""
    again: bool = False
    """where the trace explained the record, the same board once more with what it found; with trace"""

    figures: Texts = ()
    """figures of a data sheet, by the names of `hil characterise`, as "bias" and "angle_random_walk": a column each"""

    @model_validator(mode="after")
    def _figures_are_known(self) -> Self:
        if unknown := [name for name in self.figures if name not in BY_NAME]:
            raise ValueError(f"figures: {unknown[0]}: no figure of a data sheet; there are {', '.join(BY_NAME)}")
        return self

    @model_validator(mode="after")
    def _again_after_a_trace(self) -> Self:
        if self.again and not self.trace:
            raise ValueError("again: nothing is traced; give trace = true as well")
        return self


@with_fields(RunOptions)
class Run(Section):
    """What is asked of every run, as of `hil run`: the clock is lockstep in any case."""

    @model_validator(mode="after")
    def _of_a_campaign(self) -> Self:
        asked = chosen(RunOptions, dict(self))
        if asked["clock"] not in (None, "lockstep"):
            raise ValueError(f"clock: {asked['clock']}: the runs of a campaign are in lockstep; leave it out")
        return self


@with_fields(TraceOptions)
class Trace(Section):
    """What is asked of every trace, as of `hil trace`; with [each] trace. No page is drawn and no missing force
    estimated but where that is asked for."""

    @model_validator(mode="after")
    def _of_one_record(self) -> Self:
        asked = chosen(TraceOptions, dict(self))
        if asked["covariate"] is not None or asked["hold_out"]:
            raise ValueError("covariate and hold_out belong to several records; leave them out")
        return self


class Report(Section):
    """What the report is about."""

    figure: str = "angle_error_rms_rad"
    """the column whose dependence on the keys is worked out, and by which runs are the worst"""
    worst: Annotated[int, Field(ge=1, le=100)] = 10
    """how many of the worst runs it lists"""


class Campaign(Section):
    """A whole campaign file."""

    name: RunName
    """of the folder of its results"""
    scenario: str | None = None
    """scenario file of the board: a path, also from this file's folder, or the name of an example; not with [table] or
    [chamber], where the board is that of the bench file's [link] url"""
    bench: str
    """bench file of the host, likewise"""
    seed: Seed = 1
    """that points are drawn by, and that the seed of each run comes from"""
    seeds: Annotated[int, Field(ge=1, le=MOST_RUNS)] = 1
    """runs of each point, each with a seed of its own"""
    rows_per_file: Annotated[int, Field(ge=1, le=1_000_000)] = 256
    """runs in each Parquet file of the results"""
    design: Design = Design()
    """table [design]"""
    fixed: Annotated[dict[str, Any], Field(default_factory=dict)]
    """keys that are other than in the files in every run: "bench.loop.duration_s" = 5.0; a table or list replaces the
    whole one"""
    vary: Annotated[tuple[Vary, ...], BeforeValidator(as_tuple), Field(default_factory=tuple)]
    """one [[vary]] for each key that is varied; without any the seeds alone differ"""
    each: Each = Each()
    """table [each]"""
    run: Run = Run()
    """table [run]"""
    trace: Trace = Trace()
    """table [trace]"""
    report: Report = Report()
    """table [report]"""
    table: Table | None = None
    """table [table]"""
    chamber: Chamber | None = None
    """table [chamber]"""

    @property
    def instruments(self) -> dict[str, Instrument]:
        both: dict[str, Instrument | None] = {"table": self.table, "chamber": self.chamber}
        return {name: one for name, one in both.items() if one is not None}

    @property
    def targets(self) -> dict[str, str]:
        """By instrument the key of its targets."""
        return {name: f"{name}.{one.quantity}" for name, one in self.instruments.items()}

    @model_validator(mode="after")
    def _instruments_have_targets(self) -> Self:
        every = {key: one for one in self.vary for key in one.keys}
        if not self.instruments:
            if self.scenario is None:
                raise ValueError("scenario: missing; expected: the scenario file of the board")
            return self
        if self.scenario is not None:
            raise ValueError("scenario: an emulated board feels no table and no chamber; leave it out")
        if self.each.model_fields_set or self.trace.model_fields_set:
            raise ValueError("[each]: belongs to emulated boards, whose truth is known; leave it out")
        for name, key in self.targets.items():
            one = every.get(key)
            if one is None and key not in self.fixed:
                raise ValueError(f'[{name}]: no targets; give [[vary]] key = "{key}", or "{key}" in [fixed]')
            values = [self.fixed[key]] if one is None else [*(one.values or ()), one.low, one.high]
            limit = self.instruments[name].limit
            if one is not None and (one.mean is not None or one.relative):
                raise ValueError(f"[[vary]] key: {key}: takes values, or low and high; give those")
            for value in values:
                if value is not None and (not isinstance(value, int | float) or abs(value) > limit):
                    raise ValueError(f"{key}: {value!r} is beyond [{name}] limit = {limit:g}; correct one of them")
        return self

    @model_validator(mode="after")
    def _keys_differ(self) -> Self:
        names = [one.column for one in self.vary]
        for place, one in enumerate(self.vary):
            if names.count(one.column) > 1:
                raise ValueError(f"[[vary]] {place + 1} name: {one.column} is another's too; give each a name")
            gridded = self.design.kind == "grid"
            if gridded and one.values is None and one.levels is None:
                raise ValueError(f"[[vary]] {place + 1} levels: {one.column}: a grid needs values or levels")
            if not gridded and one.levels is not None:
                raise ValueError(f"[[vary]] {place + 1} levels: {one.column}: belongs to a grid; leave it out")
        every = [key for one in self.vary for key in one.keys] + list(self.fixed)
        for key in every:
            if key in self.targets.values():
                continue
            if not key.startswith(("scenario.", "bench.")):
                raise ValueError(f"{key}: expected a key of `scenario.` or of `bench.`, such as scenario.sense.noise_V")
            if every.count(key) > 1:
                raise ValueError(f"{key}: is set twice; leave one out")
        for key, value in chosen(RunOptions, dict(self.run)).items():
            if key in OF_THE_LOOP and value is not None and f"bench.loop.{key}" in every:
                raise ValueError(f"[run] {key}: bench.loop.{key} is set too; leave one out")
        if self.trace.model_fields_set and not self.each.trace:
            raise ValueError("[trace]: nothing is traced; give [each] trace = true as well")
        if not self.vary and self.design.kind != "grid":
            raise ValueError("[design] kind: nothing is varied; leave it out, or give [[vary]]")
        return self


def read_campaign(path: Path) -> Campaign:
    """The campaign file at `path`.  Raises InputError with file, key and what was expected."""
    return parse_table(read_table(path), Campaign, str(path))
