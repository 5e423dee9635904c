"""The table [effects]: those of the catalogue and of packages by name, and [effects.custom], declared here."""

from importlib.metadata import entry_points
from typing import Annotated, Self

from pydantic import BeforeValidator, ConfigDict, Field, WithJsonSchema, model_validator

from estimator.custom import Coefficient, Declaration, Parameter
from estimator.errors import ModelError
from hil.bench.section import Positive, Section, as_tuple
from hil.toml.reading import suggestion, toml_key, toml_value

GROUP = "hil.effects"
"""Entry points of packages that bring effects."""

Tried = Annotated[
    tuple[float, ...],
    BeforeValidator(as_tuple),
    WithJsonSchema({"anyOf": [{"type": "number"}, {"type": "array", "items": {"type": "number"}, "minItems": 1}]}),
]


class OwnCoefficient(Section):
    """A number of the law that is estimated together with the states."""

    unit: str
    """SI per unit mass, `1/(m⁴·s²)` or `1/(m^4 s^2)`"""
    start: float = 0.0
    """initial value"""
    plausible: Positive | None = None
    """its likely size, the standard deviation of the initial value; without it the value that gives 5 % of the spring's
    force"""
    positive: bool = False
    """true: a negative value is physically impossible, such as friction that adds energy"""


class OwnParameter(Section):
    """A number of the law that is given and not estimated: a frequency, a threshold; a trace searches for it."""

    unit: str
    """SI"""
    value: float
    """its value"""
    tried: Tried = ()
    """values at which a trace starts its search; without them `value`"""


class OwnEffect(Section):
    """An effect of your own, given by its laws."""

    title: str = ""
    """what it is called in reports; without it its name"""
    force_x: str = ""
    """law of the force per unit mass along x, m/s²"""
    force_y: str = ""
    """along y"""
    sense_x: str = ""
    """law of the term that is added to the sensed displacement along x, m, or to its voltage, V"""
    sense_y: str = ""
    """along y"""
    carried: bool = True
    """false: the observer's model does not include it, unless [effects.NAME] gives initial values; a trace may name
    it"""
    coefficients: dict[str, OwnCoefficient] = Field(default_factory=dict)
    """a table for each: unit, start, plausible, positive"""
    parameters: dict[str, OwnParameter] = Field(default_factory=dict)
    """a table for each: unit, value, tried"""

    def declared(self, name: str) -> Declaration:
        """The same as the estimator takes it; ModelError for laws that are none, or whose units do not fit."""
        return Declaration(
            name=name,
            force=(self.force_x, self.force_y),
            sense=(self.sense_x, self.sense_y),
            coefficients={
                key: Coefficient(one.unit, one.start, one.plausible, one.positive)
                for key, one in self.coefficients.items()
            },
            parameters={key: Parameter(one.unit, one.value, one.tried) for key, one in self.parameters.items()},
            title=self.title,
            source="declared in the bench file",
        )


class Effects(Section):
    """What the base model lacks and the observer is to carry."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, dict[str, float]]

    custom: dict[str, OwnEffect] = Field(default_factory=dict)
    """effects of one's own, a table for each"""

    @property
    def named(self) -> dict[str, dict[str, float]]:
        """Those that are declared elsewhere, by name, with initial values in SI per unit mass."""
        return dict(self.__pydantic_extra__ or {})

    @model_validator(mode="after")
    def _names_are_known(self) -> Self:
        if not self.named:
            return self
        from estimator.custom.law import REST
        from estimator.effects.catalogue import EFFECTS  # and SymPy, which loads for a third of a second

        known: dict[str, list[str]] = {}
        for effect in EFFECTS:
            known[effect.name] = [*(one.name for one in effect.coefficients), *(one.name for one in effect.parameters)]
        known |= {name: [*one.coefficients, *one.parameters, REST.name] for name, one in self.custom.items()}
        packaged = entry_points(group=GROUP).names
        for name, given in self.named.items():
            kind, section = name.partition(":")[0], f"[effects.{toml_key(name)}]"
            if kind not in known and kind not in packaged:
                raise ValueError(f"{section}: no such effect; {suggestion(kind, [*known, *sorted(packaged)])}")
            for symbol in given:
                if kind in known and symbol not in known[kind]:  # of a package's effect its law is yet to be loaded
                    raise ValueError(f"{section} {symbol}: no such coefficient; {suggestion(symbol, known[kind])}")
        return self

    @model_validator(mode="after")
    def _laws_are_sound(self) -> Self:
        for name, one in self.custom.items():
            try:
                one.declared(name)
            except ModelError as error:
                raise ValueError(f"[effects.custom.{name[:40]}] {error}") from None
        return self


def own_table(name: str, own: OwnEffect) -> list[str]:
    """Lines of [effects.custom.NAME] with all that is not as it would be anyway."""
    said = own.model_dump(exclude_defaults=True)
    lines = [f"[effects.custom.{toml_key(name)}]"]
    for key, value in said.items():
        if isinstance(value, dict):
            for symbol, one in value.items():
                inner = ", ".join(f"{toml_key(word)} = {toml_value(number)}" for word, number in one.items())
                lines.append(f"{key}.{toml_key(symbol)} = {{ {inner} }}")
        else:
            lines.append(f"{key} = {toml_value(value)}")
    return lines
