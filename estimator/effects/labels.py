"""Names of effects with a label, as of one that is tested at several values of its parameters: `low_pass:2`."""

from estimator.effects.catalogue import EFFECTS
from estimator.effects.declaration import Effect
from estimator.effects.search import Search


def kind(name: str) -> str:
    """Name of an effect without its label."""
    return name.partition(":")[0]


def declared(name: str) -> Effect | None:
    """The effect of that name in the catalogue, None where it is not of it."""
    return next((effect for effect in EFFECTS if effect.name == kind(name)), None)


def searched_by(name: str) -> Search | None:
    """Where a trace takes the parameters of that effect, None where it has none or is not of the catalogue."""
    effect = declared(name)
    return None if effect is None else effect.search
