"""What a request is refused with: one line that says what is wrong, and one that says what to do."""

import logging
import sqlite3
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel
from starlette.exceptions import HTTPException

from estimator.errors import ModelError
from hil.errors import InputError, refusal_of
from hil.errors.ending import NO_ROOM, ExitCode, ending_of, fault_line
from hil.errors.input import Refusal
from hil.wire.errors import WireError

_UNDONE = "nothing was done; make room and ask again"
_LOG = logging.getLogger("hil.service")
_OTHERWISE = {
    404: "GET /openapi.json lists what there is",
    409: "GET /api/board says how the board stands; ask again when that allows it",
    413: "send less, or do it beside the service with hil",
    503: "ask again; hil serve's output says why, where it stays so",
    507: _UNDONE,
}
_ASK_RIGHTLY = "GET /openapi.json says what is expected"
_UNKNOWN = {
    404: ("there is nothing here", "GET /openapi.json, or /docs for people, lists what there is"),
    405: ("this is not done to it", "GET /openapi.json lists what is"),
}


class Problem(InputError):
    """A request that is refused with `status`; `error` and `remedy` are one line each, see `refusal`."""

    def __init__(self, status: int, error: str, remedy: str = "") -> None:
        super().__init__(error)
        self.status = status
        self.error, self.remedy = refusal(status, error, remedy)


class Unknown(Problem):
    """What is asked for by its name is not there; `what` is a run, a job, a device."""

    def __init__(self, what: str, name: str) -> None:
        super().__init__(404, f"no such {what}: {name}", f"GET /api/{what}s lists them")


class ProblemBody(BaseModel):
    """The body of every refusal."""

    error: str
    """what is wrong, one line"""
    remedy: str
    """what to do about it, one line"""


def problem_response(status: int, error: str, remedy: str = "") -> JSONResponse:
    return JSONResponse(refusal(status, error, remedy)._asdict(), status)


def refusal(status: int, error: str, remedy: str = "") -> Refusal:
    """The refusal in two lines, neither empty: where it has no remedy, what helps with most of that status."""
    return refusal_of(error, remedy, _OTHERWISE.get(status, _ASK_RIGHTLY))


def answer_problems(app: FastAPI) -> None:
    """Have every error of a route answered in that form, and none with a traceback."""

    @app.exception_handler(HTTPException)
    async def _http(_: Request, error: HTTPException) -> JSONResponse:
        said, remedy = _UNKNOWN.get(error.status_code, (str(error.detail), ""))
        answer = problem_response(error.status_code, said, remedy)
        answer.headers.update(error.headers or {})
        return answer

    @app.exception_handler(RequestValidationError)
    async def _invalid(_: Request, error: RequestValidationError) -> JSONResponse:
        return problem_response(422, *_in_words(error.errors()[0]))

    @app.exception_handler(FileNotFoundError)
    async def _gone(_: Request, error: FileNotFoundError) -> JSONResponse:
        return problem_response(404, f"{Path(error.filename or '').name}: has gone meanwhile", "ask for the list anew")

    @app.exception_handler(sqlite3.OperationalError)
    async def _catalogue(_: Request, error: sqlite3.OperationalError) -> JSONResponse:
        return problem_response(NO_ROOM, f"the catalogue: {error}", _UNDONE)

    @app.exception_handler(InputError)
    @app.exception_handler(ModelError)
    @app.exception_handler(WireError)
    @app.exception_handler(OSError)
    @app.exception_handler(Exception)
    async def _ended(_: Request, error: Exception) -> JSONResponse:
        if isinstance(error, Problem):
            return problem_response(error.status, error.error, error.remedy)
        ending = ending_of(error)
        if ending.code is ExitCode.FAULT:
            _LOG.error("%s", ending.line, exc_info=error)
            line = fault_line(error, said=False)
            return problem_response(ending.status, line, "the service's output has the details")
        remedy = _UNDONE if ending.status == NO_ROOM else ""
        return problem_response(ending.status, str(error) if isinstance(error, InputError) else ending.line, remedy)


_WORDS = {
    "missing": "missing",
    "extra_forbidden": "unknown key",
    "model_attributes_type": "expected an object of JSON",
}


def _in_words(mistake: Mapping[str, Any]) -> tuple[str, str]:
    """What is wrong with a request by the first thing that pydantic says, and what to do."""
    kind, (where, *parts), context = mistake["type"], mistake["loc"], mistake.get("ctx", {})
    if kind == "json_invalid":
        place = f", at character {parts[0]}" if parts else ""
        return f"the {where} is not JSON: {context.get('error', mistake['msg'])}{place}", "send JSON"
    if kind.startswith("union_tag_"):
        key = ".".join(map(str, (*parts, context["discriminator"].strip("'"))))
        if kind == "union_tag_not_found":
            return f"{key}: missing", _ASK_RIGHTLY
        return f"{key}: {context['tag']!r} is unknown", f"give one of {context['expected_tags'].replace(chr(39), '')}"
    place = ".".join(map(str, parts)) or f"the {where}"
    return f"{place}: {_WORDS.get(kind, mistake['msg'])}", _ASK_RIGHTLY
