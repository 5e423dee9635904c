"""What can be asked for, as it comes, and as a job's process gets it: with files in the place of names."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

from hil.bench import load_any_bench
from hil.boards.emulation import is_emulated
from hil.characterising.options import CharacteriseOptions
from hil.errors import InputError
from hil.identifying.options import IdentifyOptions
from hil.importing.options import ImportOptions
from hil.options import with_fields
from hil.records.kind import RUN_NAME
from hil.replaying.options import ReplayOptions
from hil.running.options import RunOptions
from hil.sensors.options import RecordOptions
from hil.service.bench_files import files, found
from hil.service.board.links import require_sensor
from hil.service.jobs.uploads import Uploads
from hil.sweeping.options import SweepOptions
from hil.tracing.options import TraceOptions
from hil.wire.link_name import Emulated, parse_link

Name = Annotated[str, StringConstraints(pattern=RUN_NAME, max_length=60)]
Word = Annotated[str, StringConstraints(max_length=200)]
_SCENARIO = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,150}")


class _Asked(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


@with_fields(RunOptions)
class AskedRun(_Asked):
    """A run of an emulated board. A real board is started by its own requests, POST /api/board/start."""

    kind: Literal["run"]
    bench: Word
    link: Word | None = Field(default=None, description="inproc:SCENARIO or pty:SCENARIO; by default the bench file's")
    score: bool = Field(default=False, description="Compare the run with the truth of the emulated board")


@with_fields(RecordOptions)
class AskedRecord(_Asked):
    """A recording of a sensor that cannot be driven."""

    kind: Literal["record"]
    link: Word = Field(description="NAME:PORT, NAME being an adapter's, PORT a serial port of this machine")


@with_fields(TraceOptions)
class AskedTrace(_Asked):
    """A trace of a run's record, or of several together."""

    kind: Literal["trace"]
    run: Word | Annotated[tuple[Word, ...], Field(min_length=1, max_length=100)]
    bench: Word | None = Field(default=None, description="By default the run's own; of several it has to be given")


@with_fields(ReplayOptions)
class AskedReplay(_Asked):
    """Today's estimator on a run's record."""

    kind: Literal["replay"]
    run: Word
    bench: Word | None = Field(default=None, description="By default the run's own")
    effects_of: Word | None = Field(default=None, description="A trace whose effects the bench is given first")


@with_fields(CharacteriseOptions)
class AskedCharacterise(_Asked):
    """The figures of a data sheet, from records of one device."""

    kind: Literal["characterise"]
    run: Word | Annotated[tuple[Word, ...], Field(min_length=1, max_length=100)]
    bench: Word | None = Field(default=None, description="By default the first run's own")


@with_fields(IdentifyOptions)
class AskedIdentify(_Asked):
    """The constants of an emulated board by an experiment, or of a device by its records. A real board is driven for it
    by `hil identify` on its machine only: SAFE of the service does not reach into a job."""

    kind: Literal["identify"]
    link: Word | None = Field(default=None, description="inproc:SCENARIO or pty:SCENARIO, without `run`")
    run: Word | Annotated[tuple[Word, ...], Field(max_length=100)] = Field(
        default=(), description="Records that are there, without `link`"
    )
    save: Name | None = Field(default=None, description="Bench file that is written beside the runs; by default none")


@with_fields(ImportOptions)
class AskedImport(_Asked):
    """A record that was uploaded becomes one of this bench; a map that was uploaded along goes before one of its
    own."""

    kind: Literal["import"]
    upload: Word
    name: Name = "imported"


@with_fields(SweepOptions)
class AskedSweep(_Asked):
    """A campaign, or what is left of it, into the folder of its name: one that was cancelled goes on."""

    kind: Literal["sweep"]
    campaign: Word = Field(description="A campaign file of this bench, or an example")


Asked = Annotated[
    AskedRun | AskedRecord | AskedTrace | AskedReplay | AskedCharacterise | AskedIdentify | AskedImport | AskedSweep,
    Field(discriminator="kind"),
]

Order = dict[str, Any]
"""What a job's process is told: keywords of `hil.service.jobs.work`, JSON values; `called` is what who asked calls the
files, by their paths."""


def order_of(asked: Asked, runs: Path, path_of: Callable[[str], Path], uploads: Uploads) -> Order:
    """The order of what is asked; runs are looked up by `path_of`, which raises Unknown.

    Raises InputError for a name that is not listed, and for a link that leads to a real board.
    """
    told = asked.model_dump(exclude_none=True)
    called: dict[str, str] = {}

    def named(path: Path, name: str | None = None) -> str:
        called[str(path)] = name or path.name
        return str(path)

    match asked:
        case AskedImport():
            upload = uploads.of(asked.upload)
            called |= upload.called
            told["upload"] = str(upload.record)
            given = told.get("mapping")
            own = None if upload.map is not None or given is None else named(found(runs, "map", given))
            told["mapping"] = own if upload.map is None else str(upload.map)
        case AskedSweep():
            told |= {"campaign": named(found(runs, "campaign", asked.campaign)), "typed": asked.campaign}
        case AskedRecord():
            require_sensor(asked.link)
        case AskedRun():
            bench = found(runs, "bench", asked.bench)
            told |= {"bench": named(bench), "link": _link(asked.link, bench, runs)}
        case AskedIdentify():
            records = [asked.run] if isinstance(asked.run, str) else asked.run
            told["run"] = [named(path_of(run)) for run in records]
            if asked.link is not None:
                told["link"] = _emulated(asked.link, runs, "identify a real one with hil identify, on its machine")
            if (like := told.get("like")) is not None:
                told["like"] = named(found(runs, "bench", like))
            if asked.save is not None:
                if asked.save in files(runs, "bench"):
                    raise InputError(f"{asked.save}: there is such a bench file; give another name")
                told["save"] = named(runs.resolve().parent / f"{asked.save}.bench.toml")
        case AskedTrace() | AskedReplay() | AskedCharacterise():
            records = [asked.run] if isinstance(asked.run, str) else asked.run
            told["run"] = [named(path_of(run)) for run in records]
            if asked.bench is not None:
                told["bench"] = named(found(runs, "bench", asked.bench))
            if isinstance(asked, AskedReplay) and asked.effects_of is not None:
                told["effects_of"] = named(path_of(asked.effects_of))
    return told | {"called": called}


def _link(link: str | None, bench: Path, runs: Path) -> str | None:
    """The link with its scenario as a file; None is the bench file's own, which has to be an emulated one."""
    if link is None:
        own = getattr(getattr(load_any_bench(bench), "link", None), "url", None)
        if own is None or not is_emulated(own):
            raise InputError(
                f"{bench.name}: its link leads to no emulated board; connect and start it as a board, or give a link "
                "inproc:SCENARIO or pty:SCENARIO"
            )
        return None
    return _emulated(link, runs, "connect and start the board itself")


def _emulated(link: str, runs: Path, otherwise: str) -> str:
    """The link with its scenario as a file.  Raises InputError for another than an emulated board's."""
    board = parse_link(link)
    if not isinstance(board, Emulated) or not _SCENARIO.fullmatch(board.scenario):
        raise InputError(
            f"link {link[:100]}: a job runs emulated boards only; give inproc:SCENARIO or pty:SCENARIO, or {otherwise}"
        )
    return replace(board, scenario=str(found(runs, "scenario", board.scenario))).url
