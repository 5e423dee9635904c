"""What may be asked of a run beside bench and link: one declaration, from which every caller takes its options.

The options of `hil run`, the keywords of `hil.run` and `hil.open`, those of a test's `board.run`, the bodies of the
service's requests and [run] of a campaign file are made of it.  So a new option is a line here, and what the loop does
with it.
"""

from pathlib import Path
from typing import Annotated, Literal

from annotated_types import Ge, Gt, Le, MaxLen
from typing_extensions import TypedDict

from hil.options import Help
from hil.records.kind import RunNameOption


class RunOptions(TypedDict, total=False):
    """What may be asked of a run from wherever; what is left out, or None, is as the bench file has it."""

    duration_s: Annotated[Annotated[float, Gt(0.0), Le(1e6)] | None, Help("Length of the run in bench seconds.")]
    clock: Annotated[
        Literal["lockstep", "paced", "real"] | None, Help("Whose clock the run follows; by default the bench's.")
    ]
    seed: Annotated[
        Annotated[int, Ge(0), Le(2**63 - 1)] | None, Help("Seed of the dither and of an emulated board's noise.")
    ]
    name: RunNameOption
    note: Annotated[Annotated[str, MaxLen(10_000)] | None, Help("A remark of the operator, kept in result.json.")]
    reference: Annotated[
        Annotated[str, MaxLen(1000)] | None,
        Help(
            "Link of a commercial gyro to record during the run, as `hil record` takes it; axis and sign: [reference]."
        ),
    ]
    open_loop: Annotated[bool, Help("Hold the drive at zero: ring-down, noise floor.")]


class FileOptions(TypedDict, total=False):
    """What names files of the machine on which it runs: no request over HTTP does."""

    truth: Annotated[
        Path | str | None, Help("File into which an emulated board writes its true states, for `hil score`.")
    ]
    replace: Annotated[bool, Help("Overwrite an existing file.")]
    wire_log: Annotated[Path | str | None, Help("File for the frames of a CAN link: NAME.log (candump), .blf or .asc.")]


class LocalRunOptions(RunOptions, FileOptions, total=False):
    """All of them."""


OF_THE_LOOP = ("duration_s", "clock", "seed", "name")
"""Options that are keys of [loop] in a bench file."""
