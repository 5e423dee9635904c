"""A campaign as it is asked for: for every caller alike."""

from collections.abc import Mapping
from dataclasses import dataclass
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING

from hil.bench.examples import find
from hil.errors import InputError
from hil.errors.input import path_of, require
from hil.options import chosen
from hil.records.kind import fresh
from hil.records.runs import RUNS
from hil.sweeping.baseline import read_baseline
from hil.sweeping.campaign import Campaign
from hil.sweeping.options import LocalSweepOptions, SweepOptions
from hil.sweeping.plan import Plan, plan_of, read_plan
from hil.toml.reading import parse_table

if TYPE_CHECKING:
    import pyarrow

AnyCampaign = Campaign | Mapping[str, object] | Path | str


@dataclass(frozen=True)
class CampaignRequest:
    """The plan of the campaign, the folder of its results, and on what the runs are made, see `LocalSweepOptions`."""

    plan: Plan
    folder: Path
    workers: int | None = None
    scheduler: str | None = None
    arm: bool = False
    baseline: "pyarrow.Table | None" = None
    junit: Path | None = None


def request_of(campaign: AnyCampaign, options: SweepOptions, *, called: str | None = None) -> CampaignRequest:
    """Put together what is asked of a campaign: a file, or what would stand in one; `called`: how a command names it.

    Raises InputError that names the option, or the key.
    """
    given = chosen(LocalSweepOptions, options)
    if isinstance(campaign, str | Path):
        plan = read_plan(find("campaign", str(campaign)), called=called or str(campaign))
    else:
        known = campaign if isinstance(campaign, Campaign) else parse_table(campaign, Campaign, "the campaign")
        plan = plan_of(known, known.name)
    workers, scheduler = given["workers"], given["scheduler"]
    require("workers", workers, Integral | None, "a whole number")
    if workers is not None and scheduler is not None:
        raise InputError("--workers: belongs to this machine; a cluster has its own, leave one out")
    folder = RUNS / plan.campaign.name if given["out"] is None else path_of("out", given["out"])
    baseline, junit = given["baseline"], given["junit"]
    if junit is not None and baseline is None:
        raise InputError("--junit: tells what a baseline showed; give --baseline too, or leave it out")
    return CampaignRequest(
        plan, folder, workers, scheduler, bool(given["arm"]),
        None if baseline is None else read_baseline(path_of("baseline", baseline), plan),
        None if junit is None else fresh(path_of("junit", junit), replace=given["replace"]),
    )  # fmt: skip
