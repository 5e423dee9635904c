"""What may be asked of a run beside bench and link: one declaration, from which every caller takes its options.

The options of `hil run`, the keywords of `hil.run` and `hil.open`, those of a test's `board.run`, and the bodies of the
service's requests are made of it.  So a new option is a line here, and what the loop does with it.
"""

from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from annotated_types import Ge, Gt, Le, MaxLen
from typing_extensions import TypedDict

from hil.records.run_name import RUN_NAME


class Help(str):
    """What an option is, as `--help` and the API's page show it."""

    def __get_pydantic_json_schema__(self, core: Any, handler: Any) -> Any:
        return {**handler(core), "description": str(self)}


class Like(NamedTuple):
    """A pattern that a text has to follow."""

    pattern: str


class RunOptions(TypedDict, total=False):
    """What may be asked of a run from wherever; what is left out, or None, is as the bench file has it."""

    duration_s: Annotated[Annotated[float, Gt(0.0), Le(1e6)] | None, Help("Length of the run in bench seconds.")]
    clock: Annotated[
        Literal["lockstep", "paced", "real"] | None, Help("Whose clock the run follows; by default the bench's.")
    ]
    seed: Annotated[
        Annotated[int, Ge(0), Le(2**63 - 1)] | None, Help("Seed of the dither and of an emulated board's noise.")
    ]
    name: Annotated[
        Annotated[str, MaxLen(60), Like(RUN_NAME)] | None,
        Help("Last part of the run's name; by default the bench's."),
    ]
    note: Annotated[Annotated[str, MaxLen(10_000)] | None, Help("A remark of the operator, kept in result.json.")]
    open_loop: Annotated[bool, Help("Hold the drive at zero: ring-down, noise floor.")]


class LocalRunOptions(RunOptions, total=False):
    """And what names files of the machine on which it runs."""

    truth: Annotated[
        Path | str | None, Help("File into which an emulated board writes its true states, for `hil score`.")
    ]
    replace: Annotated[bool, Help("Write over a file that exists already.")]
    wire_log: Annotated[Path | str | None, Help("File for the frames of a CAN link: NAME.log (candump), .blf or .asc.")]


OF_THE_LOOP = ("duration_s", "clock", "seed", "name")
"""Options that are keys of [loop] in a bench file."""
