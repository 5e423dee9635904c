"""What may be asked of a trace beside records and bench: one declaration, from which every caller takes its options.

As `hil.running.options`: `hil trace`, `hil.trace`, a trace in a test, the service's requests and [trace] of a campaign
file are made of it.
"""

from typing import Annotated

from annotated_types import Gt, Lt, MaxLen
from typing_extensions import TypedDict

from hil.options import Default, Help, Names
from hil.records.kind import RunNameOption


class TraceOptions(TypedDict, total=False):
    """What may be asked of a trace from wherever."""

    fraction: Annotated[
        Annotated[float, Gt(0.0), Lt(1.0)] | None,
        Help("Share of the record that is fitted; the rest is held out.  [default: the record's own segments, or 0.6]"),
    ]
    name: RunNameOption
    report: Annotated[bool, Default(True), Help("Draw report.html; leave it out to save time on many records.")]
    missing_force: Annotated[
        bool | None,
        Help(
            "Estimate the missing force.  [default: if a residual is left and a report is drawn]",
        ),
    ]
    covariate: Annotated[
        Annotated[str, MaxLen(200)] | None,
        Help("For several records: name of a quantity, one value per record, that coefficients may depend on."),
    ]
    hold_out: Annotated[
        Names, Help("For several records: name of one to hold out; repeatable.  [default: a third of them]")
    ]
