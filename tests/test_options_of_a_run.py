"""Each option of a run, with a value of its kind, reaches the loop through every caller: nothing here names one."""

import asyncio
import json
from collections.abc import Callable, Mapping
from contextlib import nullcontext, suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NoReturn, get_args

import pytest
from pydantic import TypeAdapter, ValidationError

import hil
from hil.bench import load_bench
from hil.bench.examples import find
from hil.boards.emulation import located
from hil.cli import execute
from hil.cli.options import as_words
from hil.client import Board
from hil.errors.ending import ExitCode
from hil.options import Keyword, body_of, declared, keywords_of
from hil.progress import untold
from hil.running.options import OF_THE_LOOP, LocalRunOptions, RunOptions
from hil.running.process.worker import Order
from hil.running.request import RunRequest
from hil.running.run import run
from hil.service.board.part import BoardPart
from hil.service.jobs.asked import AskedRun, order_of
from hil.service.jobs.work import do
from hil.service.routes_board import Start
from hil.sweeping.campaign import Campaign
from hil.sweeping.one_run import carry_out
from hil.sweeping.plan import plan_of
from hil.testing.board import BoardUnderTest


def tried(one: Keyword) -> Any:
    """A value that an option takes, and is not without."""
    kinds = (one.type, *get_args(one.type))
    for value in (30.5, 30, "asked", *(word for kind in kinds for word in get_args(kind))):
        with suppress(ValidationError, TypeError):
            if TypeAdapter(declared(one)).validate_python(value) == value:
                return value
    return not one.default


class Reached(Exception):
    """The loop would begin."""


@pytest.fixture
def orders(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[RunRequest]:
    """What the loop is told by runs that end where it would begin; nothing is opened for their options."""
    told: list[RunRequest] = []

    def begins(*given: Any, **_: Any) -> NoReturn:
        order = next(one for one in given if isinstance(one, Order))
        told.append(RunRequest.of_json(json.loads(order.line)["request"]))
        raise Reached

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("hil.running.run.supervise", begins)
    monkeypatch.setattr("hil.running.process.worker.work", begins)
    for opened in ("run._logged", "run.recorded_beside", "run.worker_process", "run.concluding.artist"):
        monkeypatch.setattr(f"hil.running.{opened}", lambda *_: nullcontext())
    monkeypatch.setattr("hil.running.request.require_reference", lambda *_, **__: None)
    return told


LINK = "inproc:s-slow"


def typed(given: dict[str, Any]) -> None:
    assert execute(["run", "s-slow", "--link", LINK, *as_words(LocalRunOptions, given)]) == ExitCode.FAULT


def called(given: dict[str, Any]) -> None:
    hil.run("s-slow", link=LINK, **given)


def posted(given: dict[str, Any]) -> None:
    """From the client to the process that holds the board."""
    body: dict[str, Any] = {}

    def request(*_: str, json: dict[str, Any], **__: Any) -> dict[str, Any]:
        body.update(json)
        return {"run": ""}

    service: Any = SimpleNamespace(requests=SimpleNamespace(json=request))
    Board(service, "", "", wait=False).start("s-slow", **given)
    here: Any = SimpleNamespace(folder=Path(), private=Path(), files={})
    part = BoardPart(here)
    part._told |= {"connected": True, "link": located(LINK)}
    sent: dict[str, Any] = {}

    async def ask(_: str, __: float, **message: Any) -> dict[str, Any]:
        sent.update(message)
        return {"run": ""}

    part.line.ask = ask  # type: ignore[method-assign, assignment]
    asyncio.run(part.start(Start(**body).start, consent=True, agreed=None))
    run(RunRequest.of_json(sent["request"]), Path("runs"), progress=untold)


def as_a_job(given: dict[str, Any]) -> None:
    asked = AskedRun(kind="run", bench="s-slow", link=LINK, **body_of(RunOptions, given))
    uploads: Any = None
    do(order_of(asked, Path("runs"), Path, uploads), Path("runs"), Path(), began=lambda _: None, progress=untold)


def of_a_campaign(given: dict[str, Any]) -> None:
    campaign = {"name": "c", "scenario": "s-slow", "bench": "s-slow", "run": body_of(RunOptions, given)}
    carry_out(plan_of(Campaign.model_validate(campaign), "here").task(0))


def in_a_test(given: dict[str, Any]) -> None:
    BoardUnderTest(load_bench(find("bench", "s-slow")), located(LINK), Path("runs"), may_arm=True).run(**given)


REACHES: Mapping[str, tuple[type, Callable[[dict[str, Any]], None]]] = {
    "command line": (LocalRunOptions, typed),
    "library": (LocalRunOptions, called),
    "service": (RunOptions, posted),
    "job": (RunOptions, as_a_job),
    "campaign": (RunOptions, of_a_campaign),
    "pytest": (RunOptions, in_a_test),
}


@pytest.mark.parametrize(
    ("caller", "one"),
    [
        pytest.param(name, one, id=f"{name}: {one.name}")
        for name, (all_, _) in REACHES.items()
        for one in keywords_of(all_)
    ],
)
def test_it_reaches_the_loop(orders: list[RunRequest], caller: str, one: Keyword) -> None:
    given = {one.name: tried(one)}
    if one.name != "clock":
        given["clock"] = "lockstep"
    with suppress(Reached):
        REACHES[caller][1](given)
    (request,) = orders
    there = request.bench.loop if one.name in OF_THE_LOOP else SimpleNamespace(**request.options)
    assert str(getattr(there, one.name)).startswith(str(given[one.name]))  # a campaign numbers the names


@pytest.mark.parametrize("one", [pytest.param(one, id=one.name) for one in keywords_of(LocalRunOptions)])
def test_a_value_of_another_kind_is_refused_by_the_name_of_its_option(orders: list[RunRequest], one: Keyword) -> None:
    given: dict[str, Any] = {one.name: object()}
    with pytest.raises(hil.InputError, match=rf"\b{one.name}\b.*: .*object"):
        hil.run("s-slow", link=LINK, **given)
    assert not orders
