"""The record files of a run: which columns the estimator's names become, and how its rows get there."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.observer import Estimates, Observer
from hil.bench import Bench
from hil.inputs.declared import formula_of
from hil.plugins.plugged import Plugged
from hil.records.capture import board_layout, trims_layout
from hil.records.clock import clock_layout
from hil.records.estimates import board_estimates_layout, covariance_layout, estimates_layout, innovation_layout
from hil.records.layout import Layout
from hil.records.timing import ledger_layout, timing_layout
from hil.records.units import unit_of
from hil.running.recording.angle import ReportedAngle
from hil.running.safety.trim_outputs import Output
from hil.wire.messages import Capabilities, EstimatedEntries, Identity

COLUMNS = {
    "x": "x_m",
    "vx": "vx_mps",
    "y": "y_m",
    "vy": "vy_mps",
    "phi_x": "phi_x_V",
    "phi_y": "phi_y_V",
    "rate": "rate_rad_s",
    **{name: f"{name}_per_s2" for name in ("kxx", "kyy", "kxy")},
    **{name: f"{name}_per_s" for name in ("dxx", "dyy", "dxy")},
    "drive_gain_x": "drive_gain_x",
}


ANGLES = ("angle", "angle_forced", "angle_pattern", "angle_plain", "angle_rate_integral")
"""Of the estimator's output; all are counted from one zero."""


def run_layouts(
    observer: Observer, bench: Bench, identity: Identity, outputs: Sequence[Output] = ()
) -> dict[str, Layout]:
    """Layouts of all record files of a run against a board, by stem; `clock` only where the board has a clock of its
    own, `trims` where it has trim outputs."""
    rate = identity.tick_rate_Hz
    block, lockstep = bench.loop.block, bench.loop.clock == "lockstep"
    grace = identity.latency_ticks if bench.loop.mode == "force" else block
    deadline_us = None if lockstep else grace / rate * 1e6
    observed = observer_layouts(observer, bench)
    beside: dict[str, Layout] = {}
    if bench.loop.mode == "force":
        beside["timing"] = timing_layout(tick_rate_Hz=rate, deadline_us=deadline_us)
    elif bench.loop.mode == "gain":
        beside["timing"] = ledger_layout(tick_rate_Hz=rate, block=block, deadline_us=deadline_us)
    elif Capabilities.ESTIMATE in Capabilities(identity.capabilities):
        beside["board_estimates"] = board_estimates_layout(
            [column_of(name.lower()) for name in EstimatedEntries.__members__ if name != "ANGLE"],
            tick_rate_Hz=rate,
            every=bench.loop.estimate_every,
            header=observed["estimates"].header,
        )
    said = identity._asdict()
    del said["capabilities"]  # its clocks depend on the link, but the same samples are the same record
    return {
        "capture": board_layout(
            tick_rate_Hz=rate,
            axes=identity.axes,
            latency_ticks=identity.latency_ticks,
            sense_scale_V=identity.sense_scale_V,
            drive_scale=identity.drive_scale_mps2,
            identity=said,
            lockstep=lockstep,
            sense_unit=bench.device.sense.unit,
        ),
        **observed,
        **beside,
        **({} if lockstep else {"clock": clock_layout(tick_rate_Hz=rate)}),
        **({"trims": trims_layout([_trim_of(one) for one in outputs], tick_rate_Hz=rate)} if outputs else {}),
    }


def _trim_of(output: Output) -> dict[str, Any]:
    told, electrode = output.told, output.electrode
    return {
        "name": told.name,
        "register": output.register,
        "lowest_V": told.lowest * told.scale_V,
        "highest_V": told.highest * told.scale_V,
        "most_V": output.most_V,
        "settling_s": told.settling_s,
        "softening_per_s2_per_V2": list(electrode.softening),
        "softening_u_per_s2_per_V2": list(electrode.softening_u),
    }


def column_of(name: str) -> str:
    """Column of an entry of the state vector; an effect's coefficient keeps its name, its unit stands in the header."""
    return COLUMNS.get(name, name)


def observer_layouts(observer: Observer, bench: Bench) -> dict[str, Layout]:
    """Layouts of `estimates.arrow`, `covariance.arrow` and `innovation.arrow`, by stem."""
    rate = observer.device.sample_rate
    own = bench.device.sense.unit
    units = {"drive_gain_x": "1", "phi_x_V": own, "phi_y_V": own, **observer.coefficient_units}
    estimated = [column_of(name) for name in observer.estimated]
    covariance = covariance_layout(
        estimated,
        [units.get(name, unit_of(name)) for name in estimated],
        tick_rate_Hz=rate,
        every=bench.loop.covariance_stride(rate),
    )
    return {
        "estimates": estimates_layout(
            [column_of(name) for name in observer.names],
            tick_rate_Hz=rate,
            every=bench.loop.estimate_every,
            angle=observer.device.axes == 2,
            units=units,
            header={
                "target_stiffness_per_s2": observer.device.target,
                "virtual_rotation_rad_s": bench.controller.virtual_rotation_rad_s,
                "virtual_reversal_s": bench.virtual_reversal_s,
                "angular_gain": bench.device.calibration.angular_gain,
                "angle": formula_of(bench).kind,
                "angle_zero_after_s": bench.loop.settle_s,
                "settings": _plain(asdict(observer.settings)),
                **({"plugins": observer.origin} if isinstance(observer, Plugged) else {}),
            },
        ),
        **({"covariance": covariance} if observer.HAS_COVARIANCE else {}),
        "innovation": innovation_layout(tick_rate_Hz=rate, axes=observer.device.axes, sense_unit=own),
    }


def innovation_rows(layout: Layout, tick: NDArray[np.int64], estimates: Estimates) -> NDArray[np.void]:
    """Rows of `innovation.arrow` for a block of samples."""
    rows = np.empty(len(tick), layout.dtype)
    rows["tick"] = tick
    _fill(rows, 1, estimates.innovation, estimates.innovation_deviation)
    return rows


def _fill(rows: NDArray[np.void], at: int, *tables: NDArray[np.float64]) -> None:
    """Put the columns of some tables (n, columns) into those of the rows, from a place on."""
    for name, values in zip((rows.dtype.names or ())[at:], chain(*(table.T for table in tables)), strict=False):
        rows[name] = values


def estimate_rows(
    layout: Layout, tick: NDArray[np.int64], estimates: Estimates, reported: ReportedAngle
) -> NDArray[np.void]:
    """Rows of `estimates.arrow` for a block of samples; `reported` has had the rows before."""
    index = estimates.index
    rows = np.zeros(len(index), layout.dtype)
    if not len(index):
        return rows
    rows["tick"] = tick[index]
    _fill(rows, 1, estimates.state, estimates.deviation)
    if estimates.innovation.shape[1] == 2:
        since_begun = [getattr(estimates, name)[index] for name in ANGLES]
        deviation = estimates.angle_deviation[index]
        dxx, dyy, dxy, kxy = (estimates.of(name) for name in ("dxx", "dyy", "dxy", "kxy"))
        times = rows["tick"] / layout.header["tick_rate_Hz"]
        motion = [estimates.of(name) for name in ("x", "vx", "y", "vy")]
        since_begun[0], rows["rate_rad_s"] = reported.calibrated(times, motion, since_begun[0], estimates.of("rate"))
        counted, rows["angle_u_rad"] = reported.follow(times, since_begun, deviation, kxy, (dxx, dyy, dxy))
        for name, angle in zip(ANGLES, counted, strict=True):
            rows[f"{name}_rad"] = angle
        rows["angle_sd_rad"] = deviation
        energy, quadrature = estimates.energy_ratio[index], estimates.quadrature_ratio[index]
        rows["energy_ratio"] = energy
        rows["quadrature_ratio"] = quadrature
        if reported.kind == "none":
            for name in ("angle_rad", "angle_u_rad", "angle_sd_rad"):
                rows[name] = np.nan
        rows["valid"] = reported.valid(energy, quadrature)
    return rows


def _plain(table: Mapping[str, Any]) -> dict[str, Any]:
    return {
        key: _plain(value) if isinstance(value, dict) else getattr(value, "value", value)
        for key, value in table.items()
    }
