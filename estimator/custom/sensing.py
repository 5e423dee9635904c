"""The map of a sense interface as an effect that is known: nothing of it is estimated."""

from estimator.custom.declaration import Declaration, Parameter
from estimator.interface import NAME, Interface


def declared_map(interface: Interface) -> Declaration | None:
    """The map as observers carry it; None where it adds nothing."""
    laws, constants = interface.laws()
    if not constants:
        return None
    return Declaration(
        name=NAME,
        sense=(laws[0], laws[1]),
        parameters={name: Parameter(unit, value) for name, (unit, value) in constants.items()},
        title=f"Sense interface, {interface.kind.replace('_', ' ')}",
        source="[device.sense.interface]",
        known=True,
    )
