"""What is estimated, from which initial value, and how much may wander."""

from typing import Any, Literal

from pydantic import field_validator

from hil.bench.section import NotNegative, Numbers, Plugin, Positive, Section

BACKEND_BEFORE = "numba"
"""How files of before call the backend that is compiled."""


class InitialSd(Section):
    """Standard deviations of the initial value."""

    position: Positive = 1.0
    """of the amplitude"""
    velocity: Positive = 1.0
    """of amplitude times target frequency"""
    offset_V: NotNegative | None = None
    """sense offset; without it [device.sense] offset_sd_V"""
    rate_rad_s: Positive = 2.0
    """rotation rate"""
    stiffness: NotNegative = 0.05
    """of the target stiffness, kxy as well; 0: known exactly"""
    damping: Positive = 1.0
    """of the mean of the declared dxx and dyy, dxy as well"""
    drive_gain: Positive = 0.2
    """of the declared drive gain (gain_known = false)"""


class Initial(Section):
    """Initial values where they differ from the data sheet's."""

    position_m: Numbers | None = None
    """one number per axis; without it 0"""
    velocity_mps: Numbers | None = None
    """one number per axis; without it 0"""
    offset_V: Numbers | None = None
    """one number per axis; without it 0"""
    rate_rad_s: float = 0.0
    """rotation rate"""
    stiffness_N_per_m: Numbers | None = None
    """without it that of [device]"""
    damping_N_s_per_m: Numbers | None = None
    """without it that of [device]"""


class ProcessNoise(Section):
    """Random walks of the states that the model treats as constant, and the force noise on the mass."""

    force_mps2_per_rtHz: NotNegative = 0.0
    """one-sided density of the force noise per mass (Brownian: √(4 kB T d)/m); the drive's is added to it"""
    rate_rad_s_per_rts: NotNegative = 0.0
    """random walk of the rate, rad/s per √s; about R/√T for a rate that changes by R within T; 0: the rate is
    constant"""
    offset_V_per_rts: NotNegative = 0.0
    """random walk of the offset, V per √s"""
    stiffness_per_rts: NotNegative = 0.0
    """random walk of the stiffness, fraction of the target stiffness per √s"""
    damping_per_rts: NotNegative = 0.0
    """random walk of the damping, fraction of the declared damping per √s"""


class Observer(Section):
    """Which states are estimated, by which gain, from which initial values."""

    variant: Literal["full", "gyro", "sense"] = "full"
    """full: 13 states; gyro: 11, no sense offsets; sense: 7, parameters taken from [device]"""
    gain: Literal["fading", "ekf", "stationary"] = "fading"
    """fading: EKF with fading memory; ekf: EKF without; stationary: gains in a table over pattern angle and phase of
    vibration, computed from the declared device, used from one memory_s after acquisition_s"""
    memory_s: Positive | None = None
    """time constant of the fading memory: some hundred cycles, and shorter than a record; without it 1, or ten cycles
    if that is longer"""
    acquisition_s: NotNegative = 0.0
    """time before the control law is switched on"""
    backend: Literal["c", "numpy", "filterpy"] = "c"
    """c: compiled; numpy, filterpy: slow reference implementations of the same model"""
    plugin: Plugin = None
    """an observer of your own instead of the bench's: FILE.py:CLASS, FILE.so, or a name from an installed package; a
    file is looked for in the folder of the bench file, then in the working directory. slow_flow: one that comes with
    the bench, on demodulated blocks of whole cycles, for a twentieth of the time"""
    initial_sd: InitialSd = InitialSd()
    """table [observer.initial_sd]"""
    initial: Initial = Initial()
    """table [observer.initial]"""
    process_noise: ProcessNoise = ProcessNoise()
    """table [observer.process_noise]"""

    @field_validator("backend", mode="before")
    @classmethod
    def _by_its_name_of_today(cls, value: Any) -> Any:
        return "c" if value == BACKEND_BEFORE else value
