"""The run itself: the link, the clock, the control law and the limits it is judged by."""

import math
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from hil.bench.classic import Loops, Mode
from hil.bench.data_sheet import with_sheet_limits
from hil.bench.section import Fraction, NotNegative, Plugin, Positive, Section
from hil.records.kind import RUN_NAME, checked_name

LEAST_ROWS = 2
"""Rows of estimates that a scored window needs: an angle counts from the first of them."""

RunName = Annotated[str, AfterValidator(checked_name), Field(json_schema_extra={"pattern": RUN_NAME})]


class Link(Section):
    """How the board is reached and how long either side waits for the other."""

    url: str | None = None
    """where the board is, when `hil run` has no --link: serial:PORT, can:NAME, pty:SCENARIO and the other links"""
    watchdog_s: Positive | None = None
    """silence after which the board drops the drive and goes SAFE, in bench time; without it 0.02, or two samples (gain
    mode: three blocks) where those last longer"""
    timeout_s: Positive = 2.0
    """how long the host waits for an answer to a command"""


class Reference(Section):
    """A commercial gyro on the same table, recorded during a run by a separate process; `hil run --reference LINK`."""

    link: str | None = None
    """where it speaks, as `hil record` takes it: serial:PORT, can:NAME, iio:HOST, or NAME:PLACE with its protocol"""
    axis: str = "z"
    """its axis that turns as the device does"""
    sign: Literal[-1, 1] = 1
    """-1 where it is mounted the other way about"""


class Loop(Section):
    """The run: its clock, its length, and the start of the scored window."""

    clock: Literal["lockstep", "paced", "real"] = "paced"
    """lockstep: the board waits for each answer; paced: emulated board on wall time; real: hardware"""
    mode: Literal["force", "gain", "board"] = "force"
    """force: the host answers every sample with a drive; gain: the board closes the loop, and the host sends it a
    matrix once per block; board: the board's own estimator closes the loop, and the host permits it once per block"""
    block: Annotated[int, Field(ge=2, le=682)] = 250
    """gain and board mode: samples in a block; a multiple or a divisor of estimate_every"""
    filter: Literal["luenberger", "pair"] = "luenberger"
    """gain mode: filter by which the board gets two signals from each axis: luenberger, an observer of the target
    oscillator; pair, the sample itself and the sample a quarter of a cycle earlier"""
    duration_s: Positive = 30.0
    """length of the run in bench time"""
    settle_s: NotNegative = 5.0
    """start of the scored window, after the run's first sample"""
    seed: Annotated[int, Field(ge=0, le=2**63 - 1)] | None = None
    """seed of the dither, in either mode, and of an emulated board's noise; without it the dither has a fixed seed and
    the board uses the seed of the scenario"""
    estimate_every: Annotated[int, Field(ge=1)] = 8
    """number of samples between two recorded estimates"""
    covariance_every: Annotated[int, Field(ge=1)] | None = None
    """number of samples between two recorded covariances of the estimates; a multiple of estimate_every, and in gain
    and board mode also of block; without it about ten per second"""
    name: RunName = "run"
    """last part of the run folder's name"""
    bench: RunName | None = None
    """what `name` was before the run, replay or trace was named otherwise; written there"""

    @model_validator(mode="after")
    def _something_to_score(self) -> Self:
        if self.settle_s >= self.duration_s:
            raise ValueError(
                f"settle_s: {self.settle_s:g} s leaves nothing to score of duration_s = {self.duration_s:g} s; "
                "run for longer, or lower it in a bench file of your own (hil init --like)"
            )
        if self.in_blocks and self.block % self.estimate_every and self.estimate_every % self.block:
            raise ValueError(
                f"estimate_every: {self.estimate_every} is neither a multiple nor a divisor of block = {self.block}"
            )
        if self.covariance_every is not None and self.covariance_every % self.covariance_unit:
            raise ValueError(
                f"covariance_every: {self.covariance_every} is no multiple of {self.covariance_unit}, the larger of "
                "estimate_every and, in gain and board mode, block"
            )
        return self

    @property
    def bench_name(self) -> str:
        """What the bench itself is called, however the run is."""
        return self.bench or self.name

    @property
    def in_blocks(self) -> bool:
        """Whether samples come in blocks, as the board computes the drive."""
        return self.mode != "force"

    @property
    def rows(self) -> int:
        """Samples that come at a time."""
        return self.block if self.in_blocks else 1

    @property
    def covariance_unit(self) -> int:
        """Samples after which there is a covariance beside an estimate: the least `covariance_every`."""
        return max(self.estimate_every, self.block) if self.in_blocks else self.estimate_every

    def scored_rows(self, sample_rate_Hz: float, every: int) -> int:
        """Rows of estimates, one every so many samples, from `settle_s` after the first of a whole run on."""
        samples, settle = round(self.duration_s * sample_rate_Hz), self.settle_s * sample_rate_Hz
        return max(samples // every - math.ceil(settle / every - 1e-9), 0)

    def coarsest_estimates(self, sample_rate_Hz: float) -> int:
        """The largest `estimate_every` of which the scored window has `LEAST_ROWS`; 0: it is too short for any."""
        samples = round(self.duration_s * sample_rate_Hz)
        each = (samples // rows for rows in range(LEAST_ROWS, samples + 1))
        return next((every for every in each if self.scored_rows(sample_rate_Hz, every) >= LEAST_ROWS), 0)

    def covariance_stride(self, sample_rate_Hz: float) -> int:
        """Every how many samples the covariance is recorded."""
        if self.covariance_every is not None:
            return self.covariance_every
        return self.covariance_unit * max(round(0.1 * sample_rate_Hz / self.covariance_unit), 1)


class Controller(Section):
    """The control law that makes the mass an isotropic undamped oscillator, and what is added to it."""

    enabled: bool = True
    """false: the drive stays at zero; for a record that another controller drove: the recorded drive is used"""
    plugin: Plugin = None
    """a controller of your own instead of the bench's, given as in [observer] plugin; if both keys have the same name,
    one instance does both"""
    mode: Mode = "whole_angle"
    """whole_angle: the source's control law; force_to_rebalance, mode_reversal, classic_whole_angle: phase, amplitude,
    quadrature and rate loops on demodulated signals, which start the vibration from rest (table [controller.loops])"""
    target_stiffness_N_per_m: Positive | None = None
    """stiffness of the controlled oscillator; without it the mean of kxx and kyy, with [trim] control the smaller of
    them"""
    energy_gain: NotNegative = 0.02
    """gain of the energy control, in units of the target frequency"""
    quadrature_gain: NotNegative = 0.01
    """gain of the quadrature control, in units of the target frequency"""
    virtual_rotation_rad_s: float = 0.0
    """imposed rotation of the pattern, subtracted from the angle"""
    virtual_reversal_s: NotNegative = 0.0
    """time between reversals of that rotation, the first after half of it; 0: never. With reversals the angle error by
    a drive gain error stays bounded. In gain mode rounded to whole pairs of blocks"""
    dither_mps2: NotNegative = 0.0
    """rms of the random force that keeps every parameter excited"""
    amplitude_modulation: Annotated[float, Field(ge=0, lt=1)] = 0.0
    """modulation of the held amplitude, as a fraction"""
    modulation_Hz: Positive = 1.0
    """frequency of that modulation"""
    stiffness_step: Annotated[float, Field(ge=0, lt=0.2)] = 0.0
    """steps of the target stiffness, up and down, as a fraction"""
    stiffness_step_Hz: Positive = 1.0
    """frequency of these steps"""
    force_limit_mps2: Positive | None = None
    """largest commanded force per mass; without it the drive's full scale"""
    loops: Loops = Loops()
    """table [controller.loops]"""


@with_sheet_limits
class Limits(Section):
    """Limits that decide the verdict and the exit code of a run."""

    innovation_ratio: Positive = 1.5
    """largest rms innovation, in units of the noise floor"""
    energy_error: Positive = 0.05
    """deviation of the energy from its target, as a fraction, up to which the angle counts as valid"""
    quadrature: Fraction = 0.05
    """quadrature, as a fraction of the energy, up to which the angle counts as valid"""
    invalid_fraction: Annotated[float, Field(ge=0, le=1)] = 0.05
    """largest share of the scored window at which the angle is not valid"""
    angle_rad: Positive = 0.1
    """largest expanded uncertainty (k = 2) of the angle at the end of the scored window"""
    late_fraction: Annotated[float, Field(ge=0, le=1)] = 0.02
    """largest share of samples whose answer was late, missing, or lost on the link"""
    lost_fraction: Annotated[float, Field(ge=0, le=1)] = 0.05
    """largest share of samples that are not in the record: lost on the link, or not taken while the board was SAFE"""
    residual_safe: Positive = 100.0
    """innovation, in units of the noise, above which the host sends SAFE"""
    rearm: Annotated[int, Field(ge=0)] = 3
    """how often in a run a board is armed again after a stop that does not latch and that the host can explain"""
    overtime: NotNegative = 0.5
    """a run on wall time may last longer than its length by this fraction, plus [link] timeout_s"""
    standstill_s: Positive = 3600.0
    """in lockstep: how long the host waits for a board that sends nothing"""
