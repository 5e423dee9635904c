"""What may be asked of a replay beside record and bench: one declaration, from which every caller takes its options."""

from typing import Annotated, Literal

from typing_extensions import TypedDict

from hil.options import Help
from hil.records.kind import RunNameOption


class ReplayOptions(TypedDict, total=False):
    """What may be asked of a replay from wherever."""

    name: RunNameOption
    backend: Annotated[
        Literal["c", "numpy", "filterpy"] | None,
        Help("Compiled, or a slow reference implementation.  [default: the bench's]"),
    ]
