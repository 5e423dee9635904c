"""An effect of one's own as it is declared: laws as text, coefficients with their units."""

import keyword
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from estimator.custom.dimension import require_unit
from estimator.custom.grammar import Number, names_in, parsed
from estimator.custom.names import QUANTITIES
from estimator.custom.unit import FORCE, METRE, VOLT, Unit, unit_of
from estimator.errors import ModelError

if TYPE_CHECKING:
    from estimator.custom.grammar import Node

PLAUSIBLE = 0.05
"""Of a coefficient where nothing is given: its force a twentieth of the spring's at amplitude."""

UNNAMED = "declared by its user"
"""Source of what does not say where it is from."""

NAME = re.compile(r"[a-z][a-z0-9_]{0,39}")
_SYMBOL = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,30}")
_TIGHT = re.compile(r"\s*(\*\*|[*/])\s*")
_MOST = 16  # coefficients, and parameters
_MOST_TRIED = 6
_RESERVED = ("v_rest",)  # a parameter of laws with sign(vx) or sign(vy)
FORCES = {FORCE: "a force per unit mass"}
SENSED = {METRE: "a sensed displacement", VOLT: "a sensed voltage"}


@dataclass(frozen=True)
class Coefficient:
    """A number that is estimated: its unit per unit mass (`1/(m⁴·s²)`), the initial value, the standard deviation with
    which it enters an observer, whether a negative one would be no such effect.
    """

    unit: str
    start: float = 0.0
    plausible: float | None = None
    positive: bool = False


@dataclass(frozen=True)
class Parameter:
    """A number that is given and not estimated, with its unit; `tried`: from where a trace searches for it, the value
    alone where nothing is given.
    """

    unit: str
    value: float
    tried: tuple[float, ...] = ()


@dataclass(frozen=True)
class Declaration:
    """An effect: what it adds to (ẍ, ÿ), a force per unit mass, and to what is sensed of x and y, in metres or volts.

    An empty law adds nothing.  Laws are read by `estimator.custom.grammar` and may speak of the names in
    `estimator.custom.names`, of their coefficients and parameters.

    Raises ModelError, one line that begins with the key, for a law that is no arithmetic or whose units do not fit.
    """

    name: str
    force: tuple[str, str] = ("", "")
    sense: tuple[str, str] = ("", "")
    coefficients: Mapping[str, Coefficient] = field(default_factory=dict)
    parameters: Mapping[str, Parameter] = field(default_factory=dict)
    title: str = ""
    source: str = UNNAMED
    signature: str = "what its law says"
    known: bool = False
    """Nothing of it is estimated: it has parameters only."""

    def __post_init__(self) -> None:
        if not NAME.fullmatch(self.name) or self.name == "custom":
            raise ModelError("name: begins with a small letter and has small letters, digits and _ only, 40 at most")
        self._require_numbers()
        units = self._units()
        laws = dict(self._laws())
        if not laws:
            raise ModelError("force_x: missing; give a law as force_x, force_y, sense_x or sense_y")
        used: set[str] = set()
        for key, node in laws.items():
            try:
                require_unit(node, FORCES if key.startswith("force") else SENSED, units, self.coefficients)
            except ModelError as error:
                raise ModelError(f"{key}: {error}") from None
            used |= names_in(node)
        for table in ("coefficients", "parameters"):
            if idle := [name for name in getattr(self, table) if name not in used]:
                raise ModelError(f"{table}.{idle[0]}: in none of the laws; use it there, or leave it out")

    @property
    def start(self) -> dict[str, float]:
        """Initial values of its coefficients, values of its parameters, SI."""
        return {
            **{name: one.start for name, one in self.coefficients.items()},
            **{name: one.value for name, one in self.parameters.items()},
        }

    def written(self) -> tuple[str, ...]:
        """Its equations as they were given, spaced as the others are."""
        left = {"force_x": "ẍ += ", "force_y": "ÿ += ", "sense_x": "sensed x += ", "sense_y": "sensed y += "}
        return tuple(left[key] + _TIGHT.sub(r"\1", " ".join(text.split())) for key, text in self._texts() if text)

    def laws(self) -> "dict[str, Node]":
        """The tree of each law, by its key."""
        return dict(self._laws())

    def _texts(self) -> tuple[tuple[str, str], ...]:
        return tuple(
            (f"{kind}_{axis}", text)
            for kind, pair in (("force", self.force), ("sense", self.sense))
            for axis, text in zip("xy", pair, strict=True)
        )

    def _laws(self) -> "list[tuple[str, Node]]":
        found: list[tuple[str, Node]] = []
        for key, text in self._texts():
            if not text:
                continue
            try:
                node = parsed(text)
            except ModelError as error:
                raise ModelError(f"{key}: {error}") from None
            if isinstance(node, Number):
                raise ModelError(f"{key}: a mere number adds nothing that could be estimated; name a coefficient")
            found.append((key, node))
        return found

    def _units(self) -> dict[str, Unit]:
        units: dict[str, Unit] = {}
        for table in ("coefficients", "parameters"):
            for name, one in getattr(self, table).items():
                try:
                    units[name] = unit_of(one.unit)
                except ModelError as error:
                    raise ModelError(f"{table}.{name}.unit: {error}") from None
        return units

    def _require_numbers(self) -> None:
        if not self.coefficients and not self.known:
            raise ModelError("coefficients: missing; an effect has at least one, as coefficients.k5.unit")
        for table in ("coefficients", "parameters"):
            names = getattr(self, table)
            if len(names) > _MOST:
                raise ModelError(f"{table}: {len(names)} of them; {_MOST} are supported")
            for name in names:
                if not _SYMBOL.fullmatch(name):
                    raise ModelError(f"{table}: a name has letters, digits and _, 31 at most; not {name[:40]!a}")
                if name in QUANTITIES or name in _RESERVED or keyword.iskeyword(name):
                    raise ModelError(f"{table}.{name}: that name has a meaning already; take another")
        if twice := sorted(set(self.coefficients) & set(self.parameters)):
            raise ModelError(f"parameters.{twice[0]}: a coefficient has that name; take another")
        tried = 1
        for one in self.parameters.values():
            tried *= max(len(one.tried), 1)
        if tried > _MOST_TRIED:
            raise ModelError(f"parameters: {tried} combinations to be tried; {_MOST_TRIED} are supported")
