"""`force.arrow` of a trace: the missing force along the record, sample by sample; and its entry in diagnosis.json."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from estimator.missing_force.result import Form, FormTerm, MissingForce
from hil.errors import InputError
from hil.numbers import finite, with_and
from hil.records import diagnosis as written
from hil.records.atomic import replacing
from hil.wire.regular_file import require_regular

KIND = "missing force"

_HEADER = b"gyrohil"


def columns(force: MissingForce) -> dict[str, npt.NDArray[np.float64]]:
    """Every column by its name, SI: time, motion, drive, force with its standard deviation, what the form leaves."""
    axes = "xy"[: force.force.shape[1]]
    table = {"t_s": force.time}
    for unit, series in (("m", force.position), ("mps", force.velocity)):
        table |= {f"{'v' if unit == 'mps' else ''}{axis}_{unit}": series[:, i] for i, axis in enumerate(axes)}
    table |= {f"u{axis}_mps2": force.drive[:, i] for i, axis in enumerate(axes)}
    if force.temperature is not None:
        table["temp_C"] = force.temperature
    for name, series, deviation in (("f", force.force, force.deviation), ("left_", force.left, force.left_deviation)):
        for i, axis in enumerate(axes):
            table[f"{name}{axis}_mps2"] = np.where(force.there, series[:, i], np.nan)
            table[f"{name}{axis}_sd_mps2"] = np.where(force.there, deviation[i], np.nan)
    return table


def save_force(path: Path, force: MissingForce) -> None:
    """Write force.arrow, whole or not at all."""
    import pyarrow as pa

    table = pa.table(columns(force)).replace_schema_metadata({_HEADER: KIND.encode()})
    with replacing(path) as scratch, pa.OSFile(str(scratch), "wb") as sink, pa.ipc.new_file(sink, table.schema) as out:
        out.write_table(table)


def is_force(path: Path) -> bool:
    """Whether a file is such a table."""
    import pyarrow as pa

    try:
        require_regular(path)
        with pa.memory_map(str(path)) as source:
            return bool((pa.ipc.open_file(source).schema.metadata or {}).get(_HEADER) == KIND.encode())
    except (OSError, pa.ArrowInvalid):
        return False


def load_force(path: Path) -> Any:
    """The table as pyarrow has it. Raises InputError for a file that is none."""
    import pyarrow as pa

    try:
        require_regular(path)
        with pa.OSFile(str(path)) as source:
            return pa.ipc.open_file(source).read_all()
    except (OSError, pa.ArrowInvalid) as error:
        raise InputError(f"{path}: cannot be read ({error}); give force.arrow of a trace") from None


def to_model(force: MissingForce) -> written.MissingForce:
    there = force.there
    rms = math.sqrt(float(np.mean(force.force[there] ** 2))) if np.any(there) else math.nan
    form = force.form
    return written.MissingForce(
        form=tuple(_term(term) for term in form.terms),
        text=said(form),
        rms_mps2=finite(rms),
        deviation_mps2=finite(float(np.sqrt(np.mean(force.deviation**2)))),
        left=finite(form.left),
        innovation_before=finite(form.before),
        innovation_after=finite(form.after),
        first=force.first,
        samples=len(force.time),
    )


def refused(reason: str) -> written.MissingForce:
    """Where no force could be estimated."""
    nothing = dict.fromkeys(("rms_mps2", "deviation_mps2", "left", "innovation_before", "innovation_after"))
    return written.MissingForce.model_validate(
        {"form": (), "text": f"no force can be estimated: {reason}", "refused": reason, **nothing}
    )


def said(form: Form) -> str:
    """One sentence: the form, and what it is worth; never a cause."""
    if not form.terms:
        return "no form of a few terms describes the force on the part held out"
    pushing = [term.form for term in form.terms if not term.sense]
    sensed = [term.form for term in form.terms if term.sense]
    parts = []
    if pushing:
        parts.append(f"the force has the form {with_and(pushing)}")
    if sensed:
        parts.append(f"what is sensed has {with_and(sensed)} in it")
    share = f"{form.left:.1%}" if form.left >= 0.001 else "less than 0.1%"
    return f"{', and '.join(parts)}; {share} of the force is left on the part held out"


def _term(term: FormTerm) -> written.FormTerm:
    return written.FormTerm(
        form=term.form,
        sensed=term.sense,
        coefficients={name: written.coefficient(one) for name, one in term.coefficients.items()},
        inside={name: written.coefficient(one) for name, one in term.threshold.items()},
        laws=dict(term.laws),
        effect=term.effect,
    )
