"""How the options of a verb are declared: once, with help, limits and default, and read by every caller.

Options are a TypedDict: a type checker knows `**options: Unpack[RunOptions]`, and nothing heavy is loaded for them.
The command line makes its options of it (`hil.cli.options`), the library its keywords (`hil.library.keywords`), the
service the fields of its bodies and a campaign file a table (`with_fields`).
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, TypeVar, get_args, get_origin, get_type_hints

if TYPE_CHECKING:
    from pydantic import BaseModel

_Body = TypeVar("_Body", bound="type[BaseModel]")
_LONGEST, _MOST = 200, 100  # characters of a name, and names, in a request


class Help(str):
    """What an option is, as `--help` and the API's page show it."""

    __slots__ = ()


class Like(NamedTuple):
    """A pattern that a text has to follow."""

    pattern: str


class Default(NamedTuple):
    """What an option is where it is not given; without one False of a switch, no names of names, else None."""

    value: Any


class Called(NamedTuple):
    """What an option is called outside of Python, where its name means something else; and by one letter."""

    name: str
    letter: str = ""


Names = str | Sequence[str]
"""One name or several; on the command line the option may be repeated."""


class Keyword(NamedTuple):
    """One option: its name here and outside of Python, its type, its limits, its help, its value where not given."""

    name: str
    called: Called
    type: Any
    limits: tuple[Any, ...]
    help: str
    default: Any

    @property
    def outside(self) -> str:
        """Its name in a body and in a file: the same, unless it means something else in Python."""
        return self.name if self.called.name == self.name.removesuffix("_s") else self.called.name

    @property
    def is_names(self) -> bool:
        """Whether it takes several."""
        return bool(self.type == Names)


def keywords_of(options: type) -> Iterator[Keyword]:
    """The options that a TypedDict declares, in its order."""
    for name, hint in get_type_hints(options, include_extras=True).items():
        kind, *said = get_args(hint)
        inner = next((one for one in get_args(kind) if get_origin(one) is Annotated), None)
        limits = () if inner is None else get_args(inner)[1:]
        bare = kind if inner is None else get_args(inner)[0] | None
        otherwise = False if bare is bool else () if bare == Names else None
        yield Keyword(
            name,
            next((one for one in said if isinstance(one, Called)), Called(name.removesuffix("_s"))),
            bare,
            limits,
            next(str(one) for one in said if isinstance(one, Help)),
            next((one.value for one in said if isinstance(one, Default)), otherwise),
        )


def chosen(options: type, given: Mapping[str, Any]) -> dict[str, Any]:
    """Of what is given the options that are declared; what is left out, or None, is its default."""
    return {
        one.name: one.default if given.get(one.name) is None else given[one.name] for one in keywords_of(options)
    }  # fmt: skip


def body_of(options: type, given: Mapping[str, Any]) -> dict[str, Any]:
    """Of what is given the options that are declared, by their names in a body."""
    return {one.outside: given[one.name] for one in keywords_of(options) if given.get(one.name) is not None}


def with_fields(options: type) -> Callable[[_Body], _Body]:
    """A decorator for a pydantic model: it has them as fields as well, with their limits and their help."""

    def around(body: _Body) -> _Body:
        from pydantic import create_model

        fields: dict[str, Any] = {one.name: (_field(one), one.default) for one in keywords_of(options)}
        return create_model(  # type: ignore[return-value]
            body.__name__, __base__=body, __module__=body.__module__, __doc__=body.__doc__, **fields
        )  # fmt: skip

    return around


def _field(one: Keyword) -> Any:
    from pydantic import Field

    field = Field(description=one.help, alias=None if one.outside == one.name else one.outside)
    if Path in get_args(one.type):  # over HTTP and in a file: the name of one of the bench's own
        return Annotated[str | None, Field(max_length=_LONGEST), field]
    return Annotated[declared(one), field]


def declared(one: Keyword) -> Any:
    """Its type with its limits, as pydantic has them."""
    from pydantic import BeforeValidator, Field, Strict

    if one.is_names:
        several = tuple[Annotated[str, Field(max_length=_LONGEST)], ...]
        return Annotated[several, BeforeValidator(_together), Field(max_length=_MOST)]
    if bool in (one.type, *get_args(one.type)):
        return Annotated[one.type, Strict()]
    limits = [Field(pattern=limit.pattern) if isinstance(limit, Like) else limit for limit in one.limits]
    return Annotated[one.type, *limits] if limits else one.type


def _together(given: Any) -> Any:
    """One name, or a list of them, as a tuple; the rest is for pydantic to refuse."""
    return (given,) if isinstance(given, str) else tuple(given) if isinstance(given, list) else given
