"""The columns of the results: what each run came to. All follow from the run's bytes alone; what was measured on the
wall stands elsewhere."""

from typing import TYPE_CHECKING, Any

from hil.bench.data_sheet import BY_NAME
from hil.sweeping.campaign import Campaign, Vary

if TYPE_CHECKING:
    import pyarrow

STATES = (
    "x_m", "vx_mps", "y_m", "vy_mps", "phi_x_V", "phi_y_V", "rate_rad_s", "kxx_per_s2", "kyy_per_s2", "kxy_per_s2",
    "dxx_per_s", "dyy_per_s", "dxy_per_s",
)  # fmt: skip

IDENTITY = {
    "run": ("int64", "its number in the campaign"),
    "point": ("int64", "number of the values of its keys"),
    "repeat": ("int64", "which of the runs of that point"),
    "seed": ("int64", "of the dither and of the board's noise"),
}

AGAIN = (
    "angle_error_rms_rad", "rate_error_rms_rad_s", "innovation_ratio", "turn_bias_mean_rad_s", "turn_bias_span_rad_s",
)  # fmt: skip
"""Figures of a run made again with what its trace found."""

FIGURES = {
    "outcome": ("string", "ran · stopped: it ended early · refused: it could not begin · crashed: its process died"),
    "reason": ("string", "why, where it did not run to its end"),
    "samples": ("int64", "recorded"),
    "record_sha256": ("string", "of capture.arrow, by which a run made again is known to be the same"),
    "angle_error_rms_rad": ("float64", "reported angle less true rotation over the scored window, zero at its start"),
    "angle_error_max_rad": ("float64", "its largest magnitude"),
    "angle_error_end_rad": ("float64", "the same at the end"),
    "angle_per_rotation": ("float64", "slope of the one over the other; null below half a radian"),
    "rate_error_rms_rad_s": ("float64", "estimated less true rate over the scored window"),
    "rate_error_max_rad_s": ("float64", "its largest magnitude"),
    "pattern_error_rms_rad": ("float64", "estimated pattern angle less that of the true state, scored window"),
    "pattern_error_end_rad": ("float64", "the same at the end"),
    "turn_bias_mean_rad_s": (
        "float64",
        "mean bias of the reported angle over the pattern angle; null without a full turn",
    ),
    "turn_bias_span_rad_s": ("float64", "bias that depends on the pattern angle, from least to largest over a turn"),
    "control_imperfection_rms_rad": ("float64", "pattern that an ideal control would not have moved"),
    "innovation_ratio": ("float64", "rms innovation over what was predicted of it"),
    "nees": ("float64", "normalised estimation error squared per entry, mean over the scored window"),
    "nees_end": ("float64", "the same at the last instant alone"),
    "nees_entries": ("int64", "how many entries of the state it is over"),
    "coverage": ("float64", "share of instants and states whose 95 % interval holds the truth"),
    "converged_s": (
        "float64",
        "time from which on the rate stays within four of the deviations stated of it at the end; null: never",
    ),
    "bound_rate_rms_rad_s": ("float64", "Cramér–Rao bound of the rate, rms over the scored window"),
    "bound_rate_end_rad_s": ("float64", "the same at the end"),
    "bound_pattern_rms_rad": ("float64", "Cramér–Rao bound of the pattern angle, rms over the scored window"),
    "bound_pattern_end_rad": ("float64", "the same at the end"),
    "verdict": ("string", "as `hil run` gives it; with [each] scan"),
    "angle_u_rad": ("float64", "standard uncertainty of the angle that the run stated, k = 1; with [each] scan"),
    "angle_expanded_rad": ("float64", "expanded uncertainty of the angle, k = 2; with [each] scan"),
    "model_complete": ("bool", "what the closing scan said of the model; with [each] scan"),
    "table_rate_rad_s": ("float64", "actual rate of the table, mean over the run; with [table]"),
    "rate_less_table_rad_s": ("float64", "mean estimated rate of the scored window less that; with [table]"),
    "chamber_C": ("float64", "actual temperature of the chamber, mean over the run; with [chamber]"),
    "traced": ("string", "verdict of the trace; with [each] trace"),
    "traced_effects": ("string", "what it named, with + between; with [each] trace"),
    **{
        f"again_{name}": ("float64", f"{name} of the same board with what the trace found; with [each] again")
        for name in AGAIN
    },
}

AT_END = {
    **{f"error_{name}": ("float64", "estimate less truth at the last instant") for name in STATES},
    **{f"sd_{name}": ("float64", "deviation that the observer states of it there") for name in STATES},
}

ALL = IDENTITY | FIGURES | AT_END


def schema(campaign: Campaign) -> "pyarrow.Schema":
    """Of the results: identity, the varied keys, figures; meanings in the metadata of the columns."""
    import pyarrow as pa

    kinds = {"int64": pa.int64(), "float64": pa.float64(), "string": pa.string(), "bool": pa.bool_()}

    def field(name: str, kind: str, meaning: str) -> "pyarrow.Field":
        return pa.field(name, kinds[kind], metadata={"meaning": meaning})

    fields = [field(name, *told) for name, told in IDENTITY.items()]
    fields += [field(one.column, kind_of(one), ", ".join(one.keys)) for one in campaign.vary]
    fields += [field(name, *told) for name, told in {**FIGURES, **AT_END}.items()]
    sheet = [BY_NAME[name] for name in campaign.each.figures]
    fields += [field(one.key, "float64", f"{one.title}, of a data sheet; null: not determined") for one in sheet]
    return pa.schema(fields, metadata={"campaign": campaign.name})


def kind_of(one: Vary) -> str:
    """Type of a varied key's column; a list stands there as text."""
    if one.values is None:
        return "float64"
    first = one.values[0]
    if isinstance(first, bool):
        return "bool"
    return "float64" if isinstance(first, int | float) else "string"


def shown(value: Any) -> Any:
    """A varied value as its column has it."""
    import json

    if isinstance(value, bool | str):
        return value
    return json.dumps(value) if isinstance(value, list | tuple | dict) else float(value)
