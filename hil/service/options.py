"""Fields of a request's body that are options declared elsewhere (`hil.loop.options`)."""

from collections.abc import Callable
from typing import Annotated, Any, TypeVar, cast

from pydantic import BaseModel, Field, Strict, create_model

from hil.library.keywords import Keyword, keywords_of
from hil.loop.options import Like, RunOptions

_Body = TypeVar("_Body", bound=BaseModel)


def with_fields(options: type) -> Callable[[type[_Body]], type[_Body]]:
    """A decorator for a body: it has them as fields as well, with their limits and their help."""

    def around(body: type[_Body]) -> type[_Body]:
        fields: dict[str, Any] = {one.name: (_field(one), one.default) for one in keywords_of(options)}
        return create_model(
            body.__name__, __base__=body, __module__=body.__module__, __doc__=body.__doc__, **fields
        )  # fmt: skip

    return around


def run_options_of(body: BaseModel) -> RunOptions:
    """What a body asks of a run."""
    return cast(RunOptions, {one.name: getattr(body, one.name) for one in keywords_of(RunOptions)})


def _field(one: Keyword) -> Any:
    if one.type is bool:
        return Annotated[bool, Strict(), Field(description=one.help)]
    limits = [limit for limit in one.limits if not isinstance(limit, Like)]
    like = next((limit.pattern for limit in one.limits if isinstance(limit, Like)), None)
    return Annotated[one.type, *limits, Field(description=one.help, pattern=like)]
