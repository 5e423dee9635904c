"""The runs of a campaign, each with its scenario and its bench; every mistake is found before the first begins."""

import hashlib
import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple, get_type_hints

from hil.bench import Bench, examples, load_bench, make_way
from hil.errors import InputError
from hil.options import chosen
from hil.running.options import OF_THE_LOOP, RunOptions
from hil.sweeping import columns as figures
from hil.sweeping import design
from hil.sweeping.campaign import Campaign, Vary, read_campaign
from hil.sweeping.design import Table, parts_of, plain, put, value_at
from hil.sweeping.tasks import Row, Task
from hil.toml.reading import parse_table, read_table, suggestion, toml_key, toml_value

_SEED = "bench.loop.seed"
_OF_THE_REQUEST = [name for name in get_type_hints(RunOptions) if name not in OF_THE_LOOP]
_LOCKSTEP = {"bench.loop.clock": "lockstep"}


class Planned(NamedTuple):
    """One run: its number, point and repetition, its seed, and the values of the varied keys by column."""

    run: int
    point: int
    repeat: int
    seed: int
    values: Mapping[str, Any]


@dataclass(frozen=True)
class Plan:
    """A campaign with its files: `scenario` and `bench` are tables, with what is fixed for all runs in them; `source`
    is named in errors, `called` is how a command names the campaign.
    """

    campaign: Campaign
    source: str
    called: str
    scenario: Table
    bench: Table

    def __len__(self) -> int:
        return design.how_many(self.campaign)

    @property
    def samples(self) -> int:
        """Of a run, where neither length nor sample rate is varied."""
        return round(float(self.bench["loop"]["duration_s"]) * float(self.bench["device"]["sample_rate_Hz"]))

    @cached_property
    def shares(self) -> design.Floats:
        """Shares of the distributions (points, keys)."""
        return design.points(self.campaign)

    def run(self, number: int) -> Planned:
        """The run of a number.  Raises InputError where there is none."""
        if not 0 <= number < len(self):
            raise InputError(f"{self.source}: no run {number}; its runs are 0 to {len(self) - 1}")
        point, repeat = divmod(number, self.campaign.seeds)
        pairs = zip(self.campaign.vary, self.shares[point], strict=True)
        values = {one.column: self._value(one, float(share)) for one, share in pairs}
        given = [values[one.column] for one in self.campaign.vary if _SEED in one.keys]
        asked = chosen(RunOptions, dict(self.campaign.run))
        fixed = self.campaign.fixed.get(_SEED) if asked["seed"] is None else asked["seed"]
        seed = given[0] if given else design.seed_of(self.campaign, point, repeat) if fixed is None else fixed
        return Planned(number, point, repeat, int(seed), values)

    def runs(self) -> Iterator[Planned]:
        return (self.run(number) for number in range(len(self)))

    def _value(self, one: Vary, share: float) -> Any:
        value = design.value_of(one, share)
        return float(value) * self._number_at(one) if one.relative else value

    def _number_at(self, one: Vary) -> float:
        side, _, key = one.key.partition(".")
        found: Any = value_at(self.scenario if side == "scenario" else self.bench, key)
        if isinstance(found, bool) or not isinstance(found, int | float):
            raise InputError(f"{self.source}: {one.key}: relative to a number, and the file has none there; give one")
        return float(found)

    def tables(self, planned: Planned) -> tuple[Table, Table]:
        """Scenario and bench of a run, as tables of their own."""
        tables = {"scenario": plain(self.scenario), "bench": plain(self.bench)}
        for one in self.campaign.vary:
            for name in one.keys:
                if name not in self.campaign.targets.values():
                    _put(tables, name, plain(planned.values[one.column]), self.source)
        tables["bench"]["loop"] |= {"seed": planned.seed, "name": f"{self._called}-{planned.run}"}
        return tables["scenario"], tables["bench"]

    def targets(self, planned: Planned) -> dict[str, float]:
        """What a run asks of table and chamber, by name."""
        values = {key: planned.values[one.column] for one in self.campaign.vary for key in one.keys}
        values |= self.campaign.fixed
        return {name: float(values[key]) for name, key in self.campaign.targets.items()}

    @property
    def _called(self) -> str:
        """What its runs are called, before their numbers."""
        return str(chosen(RunOptions, dict(self.campaign.run))["name"] or self.campaign.name)

    def bench_of(self, planned: Planned) -> Bench:
        """The bench of a run.  Raises InputError with the key."""
        return parse_table(self.tables(planned)[1], Bench, f"{self.source}: run {planned.run}: the bench")

    def identity(self, number: int) -> Row:
        """Number, point, repetition, seed and the values of the varied keys."""
        planned = self.run(number)
        varied = {name: figures.shown(value) for name, value in planned.values.items()}
        return {"run": number, "point": planned.point, "repeat": planned.repeat, "seed": planned.seed, **varied}

    def task(self, number: int, scratch: str | None = None) -> Task:
        """A run as it is handed out; raises InputError with the key."""
        planned = self.run(number)
        scenario, _ = self.tables(planned)
        what = {
            "scenario": toml_of(scenario, "The board."),
            "bench": self.bench_of(planned).model_dump_json(),
            "each": self.campaign.each.model_dump(),
            "run": self.campaign.run.model_dump(include=set(_OF_THE_REQUEST)),
            "trace": self.campaign.trace.model_dump(exclude_unset=True),
        }
        return Task(number, what, scratch)

    def require_sound(self) -> None:
        """Have the emulator read the first run's scenario: a key that it does not know is told before anything is
        made.  Raises InputError with it.
        """
        if self.campaign.instruments:
            return
        import tempfile

        from hil.wire.inproc import open_inproc
        from hil.wire.link_name import Emulated

        scenario, _ = self.tables(self.run(0))
        with tempfile.TemporaryDirectory() as place:
            file = Path(place) / "board.scenario.toml"
            file.write_text(toml_of(scenario, "The board."), encoding="utf-8")
            try:
                open_inproc(Emulated("inproc", str(file))).close()
            except ValueError as error:
                raise InputError(f"{self.source}: run 0: {str(error).replace(f'{file}: ', 'the scenario: ')}") from None

    def as_run(self) -> dict[str, Any]:
        """Campaign, scenario and bench as they were read: what a folder is of can be told without the files."""
        campaign = self.campaign.model_dump(mode="json", exclude_none=True)
        return {"campaign": campaign, "scenario": self.scenario, "bench": self.bench}

    @cached_property
    def fingerprint(self) -> str:
        """The same for campaigns whose runs are the same."""
        told = {
            "campaign": self.campaign.model_dump(mode="json", exclude={"report"}),
            "scenario": self.scenario,
            "bench": self.bench,
        }
        return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()


def plan_of(campaign: Campaign, source: str, *, called: str | None = None, beside: Path | None = None) -> Plan:
    """The plan of a campaign; `beside`: a file from whose folder paths are looked for, too.

    Raises InputError with the key: files that are not there, keys that a bench does not have or that take another
    kind of value, runs that are too many.
    """
    scenario: Table = {}
    if campaign.scenario is not None:
        scenario_file = examples.find("scenario", campaign.scenario, beside=beside)
        scenario = plain(read_table(scenario_file))
        rate = scenario.get("rate")
        if isinstance(rate, dict) and isinstance(rate.get("path"), str):
            rate["path"] = str((scenario_file.parent / rate["path"]).resolve())
    bench = plain(load_bench(examples.find("bench", campaign.bench, beside=beside)).model_dump())
    tables = {"scenario": scenario, "bench": bench}
    asked = {f"bench.loop.{key}": value for key, value in campaign.run if key in OF_THE_LOOP and value is not None}
    lockstep = {} if campaign.instruments else _LOCKSTEP
    for name, value in {**campaign.fixed, **asked, **lockstep}.items():
        if name not in campaign.targets.values():
            _put(tables, name, plain(value), f"{source}: [fixed]")
    plan = Plan(campaign, source, called or source, scenario, bench)
    _check_columns(plan)
    _check(plan)
    return plan


def read_plan(path: Path, called: str | None = None) -> Plan:
    """The plan of a campaign file, that commands call by its path or as given."""
    return plan_of(read_campaign(path), str(path), called=called, beside=path)


def _check_columns(plan: Plan) -> None:
    for place, one in enumerate(plan.campaign.vary):
        if one.column in figures.ALL:
            raise InputError(
                f"{plan.source}: [[vary]] {place + 1} name: {one.column} is a column of the results; give another"
            )
        if re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", one.column) is None:
            raise InputError(
                f"{plan.source}: [[vary]] {place + 1} name: {one.column!r} is no name of a column; give one "
                "of letters, digits and _"
            )
    numbers = [name for name, (kind, _) in figures.ALL.items() if kind == "float64"]
    if (figure := plan.campaign.report.figure) not in numbers:
        raise InputError(f"{plan.source}: [report] figure: no column {figure!r}; {suggestion(figure, numbers)}")


def _check(plan: Plan) -> None:
    """Benches at the ends of each key alone, as far as they can be told; the first run as a whole."""
    first = plan.run(0)
    for place, one in enumerate(plan.campaign.vary):
        for share in (0.0, 1.0 - 1e-9) if one.mean is None else (0.025, 0.975):
            value = plan._value(one, share)
            there = f"{plan.source}: [[vary]] {place + 1} {one.column} = {value!r}: the bench"
            tables = {"scenario": plain(plan.scenario), "bench": plain(plan.bench)}
            for name in one.keys:
                if name not in plan.campaign.targets.values():
                    _put(tables, name, value, f"{plan.source}: [[vary]] {place + 1}")
            parse_table(tables["bench"], Bench, there)
    plan.bench_of(first)


def _put(tables: Mapping[str, Table], name: str, value: Any, source: str) -> None:
    side, _, key = name.partition(".")
    strict = side == "bench" and not key.startswith("effects.")
    try:
        strict = strict and not make_way(tables[side], _nested(key, value))
        put(tables[side], key, value, strict=strict)
    except InputError as error:
        raise InputError(f"{source}: {side}.{error}") from None


def _nested(key: str, value: Any) -> Table:
    """A value under its key as tables, without positions in a list."""
    *way, last = (part for part in parts_of(key) if isinstance(part, str))
    nested = {last: value}
    for part in reversed(way):
        nested = {part: nested}
    return nested


def toml_of(table: Table, remark: str) -> str:
    """A table of tables as a TOML file with a first remark; what is below the second level stands in one line."""
    plain_keys = {key: value for key, value in table.items() if not isinstance(value, dict) and value is not None}
    lines = [f"# {remark}", *(f"{toml_key(key)} = {_inline(value)}" for key, value in plain_keys.items())]
    for key, section in table.items():
        if isinstance(section, dict):
            lines += ["", f"[{toml_key(key)}]"]
            lines += [f"{toml_key(name)} = {_inline(one)}" for name, one in section.items() if one is not None]
    return "\n".join(lines) + "\n"


def _inline(value: Any) -> str:
    if isinstance(value, dict):
        pairs = (f"{toml_key(key)} = {_inline(one)}" for key, one in value.items() if one is not None)
        return f"{{ {', '.join(pairs)} }}"
    if isinstance(value, list):
        return f"[{', '.join(map(_inline, value))}]"
    return toml_value(value)
