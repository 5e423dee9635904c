"""What can be asked for, as it comes, and as a job's process gets it: with files in the place of names."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

from hil.bench import load_any_bench
from hil.boards.emulation import is_emulated
from hil.errors import InputError
from hil.loop.options import RunOptions
from hil.records.run_name import RUN_NAME
from hil.service.bench_files import found
from hil.service.jobs.uploads import Uploads
from hil.service.options import with_fields
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
    score: bool = Field(default=False, description="Hold the run against the truth of the emulated board")


class AskedTrace(_Asked):
    """A trace of a run's record."""

    kind: Literal["trace"]
    run: Word
    bench: Word | None = Field(default=None, description="By default the run's own")
    fraction: Annotated[float, Field(gt=0, lt=1)] | None = None
    name: Name | None = None


class AskedReplay(_Asked):
    """Today's estimator on a run's record."""

    kind: Literal["replay"]
    run: Word
    bench: Word | None = Field(default=None, description="By default the run's own")
    effects_of: Word | None = Field(default=None, description="A trace whose effects the bench is given first")
    name: Name | None = None


class AskedImport(_Asked):
    """A record that was uploaded becomes one of this bench."""

    kind: Literal["import"]
    upload: Word
    map: Word | None = Field(default=None, description="A map of this bench, where none was uploaded along")
    hold: Literal["zoh", "foh", "bandlimited"] | None = None
    nonuniform: bool = False
    name: Name = "imported"


class AskedSweep(_Asked):
    """A campaign, or what is left of it, into the folder of its name: one that was cancelled goes on."""

    kind: Literal["sweep"]
    campaign: Word = Field(description="A campaign file of this bench, or an example")
    workers: Annotated[int, Field(ge=1, le=256)] | None = Field(
        default=None, description="Processes; by default half as many as there are processors"
    )


Asked = Annotated[AskedRun | AskedTrace | AskedReplay | AskedImport | AskedSweep, Field(discriminator="kind")]

Order = dict[str, Any]
"""What a job's process is told: keywords of `hil.service.jobs.work`, JSON values; `called` is what who asked calls the
files, by their paths."""


def order_of(asked: Asked, runs: Path, path_of: Callable[[str], Path], uploads: Uploads) -> Order:
    """The order of what is asked; runs are looked up by `path_of`, which raises KeyError.

    Raises InputError for a name that is not listed, and for a link that leads to a real board.
    """
    told = asked.model_dump(exclude_none=True)
    if isinstance(asked, AskedImport):
        upload = uploads.of(asked.upload)
        told["upload"] = str(upload.record)
        called = dict(upload.called)
        told["map"] = None if upload.map is None else str(upload.map)
        if upload.map is None and asked.map is not None:
            told["map"] = str(found(runs, "map", asked.map))
            called[told["map"]] = Path(told["map"]).name
        return told | {"called": called}
    if isinstance(asked, AskedSweep):
        campaign = found(runs, "campaign", asked.campaign)
        return told | {"campaign": str(campaign), "typed": asked.campaign, "called": {str(campaign): campaign.name}}
    if isinstance(asked, AskedRun):
        bench = found(runs, "bench", asked.bench)
        return told | {"bench": str(bench), "link": _link(asked.link, bench, runs), "called": {str(bench): bench.name}}
    told |= {"run": str(path_of(asked.run)), "called": {str(path_of(asked.run)): path_of(asked.run).name}}
    if asked.bench is not None:
        told["bench"] = str(found(runs, "bench", asked.bench))
        told["called"][told["bench"]] = Path(told["bench"]).name
    if isinstance(asked, AskedReplay) and asked.effects_of is not None:
        told["effects_of"] = str(path_of(asked.effects_of))
        told["called"][told["effects_of"]] = Path(told["effects_of"]).name
    return told


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
    board = parse_link(link)
    if not isinstance(board, Emulated) or not _SCENARIO.fullmatch(board.scenario):
        raise InputError(
            f"link {link[:100]}: a job runs emulated boards only; give inproc:SCENARIO or pty:SCENARIO, or connect and "
            "start the board itself"
        )
    return replace(board, scenario=str(found(runs, "scenario", board.scenario))).url
