"""Rate table: commercial gyros as rate-output sensors, steady and stepped."""

from pathlib import Path

import numpy as np

from estimator.diagnosis import Diagnosis
from estimator.scaling import Array
from evaluation.measured.oscillator import imported
from evaluation.measured.outcome import MeasuredRow, Outcome, Say, rms
from hil.bench import RateSensorBench, examples, load_any_bench
from hil.tracing.rate_sensor import trace_rate_sensor

FOLDER = "rate_table"
_SENSORS = ("crs03", "crs09", "crh02")
_STEPPED = ("crs03", "crs09")


def measure(data: Path, work: Path, say: Say) -> Outcome:
    """Each sensor from the ±100 and ±200 °/s runs to the ±400 °/s run; the step by alternate blocks."""
    rows, words = steady(data / "static.csv", work, say)
    for sensor in _STEPPED:
        say(f"rate table: {sensor}, step")
        found = _traced(data / "step_50dps.csv", work, sensor, f"rate-table-{sensor}-step")
        rows.append(_row(sensor, "step, other blocks", found, 1e3, "mV"))
        effects = [effect.name for effect in found.effects]
        errors = (1e3 * _whole(found.residual_before), 1e3 * _whole(found.residual_after))
        rows.append(
            MeasuredRow(
                FOLDER, f"{sensor} step, whole", "rms of the output", "mV", *errors, found.verdict.value, effects
            )
        )
        words.append(_described(f"{sensor.upper()}, step", found))
    return Outcome("Rate table", rows, words)


def steady(table: Path, work: Path, say: Say) -> tuple[list[MeasuredRow], list[str]]:
    """Rows and words of the static curves."""
    rows, words = [], []
    for sensor in _SENSORS:
        say(f"rate table: {sensor}, steady states")
        found = _traced(table, work, sensor, f"rate-table-{sensor}")
        rows.append(_row(sensor, "±400 °/s", found, 1.0, "V"))
        words.append(_described(f"{sensor.upper()}, steady states", found))
    return rows, words


def _traced(source: Path, work: Path, sensor: str, map_name: str) -> Diagnosis:
    imported(source, work, map_name)
    bench = load_any_bench(examples.find("bench", f"rate-table-{sensor}"))
    assert isinstance(bench, RateSensorBench)  # the example says axes = 0
    return trace_rate_sensor(work / f"{map_name}-{source.name.partition('.')[0]}.arrow", bench)


def _whole(residual: Array) -> float:
    """Rms of what the record tells."""
    left = residual[:, 0]
    return rms(left[np.isfinite(left)])


def _row(sensor: str, split: str, found: Diagnosis, factor: float, unit: str) -> MeasuredRow:
    before, after = found.held_out_before.innovation_rms[0], found.held_out_after.innovation_rms[0]
    effects = [effect.name for effect in found.effects]
    verdict = found.verdict.value
    return MeasuredRow(
        FOLDER, f"{sensor} {split}", "rms of the output", unit, factor * before, factor * after, verdict, effects
    )


def _described(title: str, found: Diagnosis) -> str:
    lines = [f"{title}: {found.verdict.value}.", ""]
    for effect in found.effects:
        parts = [
            f"{name} = {i.value:.5g} [{i.low:.5g}, {i.high:.5g}] {i.unit}" for name, i in effect.coefficients.items()
        ]
        lines.append(
            f"- **{effect.name}** (`{effect.equation[0]}`): {'; '.join(parts)}; evidence {effect.evidence:.0f}"
        )
    lines += [f"- {c.effect} and {c.other} look alike on this record ({c.correlation:.4f})" for c in found.separations]
    lines += [f"- {reason}" for reason in found.reasons]
    return "\n".join(lines)
