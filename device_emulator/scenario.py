"""Scenario files: what the emulated board really is. The host never opens one; it only hands its path on.

Units stand in the key names; a per-axis value is one number for both axes or `[x, y]`.
"""

import math
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import Discriminator, Field, PlainValidator, Tag, ValidationError, model_validator

from device_emulator.effects import catalogue as effects
from device_emulator.effects.declaration import MAX_INNER
from device_emulator.faults import Faults
from device_emulator.modes import KEYS, in_matrices
from device_emulator.rate import Rate
from device_emulator.section import (
    Damping,
    NonNegative,
    Pair,
    PerAxis,
    PerAxisNonNegative,
    PerAxisPositive,
    PerAxisPositiveOrInf,
    Positive,
    ScenarioError,
    Section,
    Stiffness,
    did_you_mean,
)
from device_emulator.temperature import Temperature
from device_emulator.trim import MAX_TRIMS, Trim
from hil.wire.regular_file import what_instead
from hil.wire.toml_bounds import MOST_BYTES, beyond

MAX_LATENCY_SAMPLES = 64
SLOWEST_HZ, FASTEST_HZ = 1e-3, 1e8
LARGEST_M, LARGEST_MPS, LARGEST_RAD_S = 10.0, 1e6, 1e6
HOTTEST_K = 1e5
MAX_DELAY_SAMPLES = 30  # of the sense_delay and drive_delay effects


class Truth(Section):
    """`[truth]`: the mass on its springs. Matrices are symmetric: [xx, yy, xy]."""

    mass_kg: Positive
    """proof mass"""
    stiffness_N_per_m: Stiffness
    """[kxx, kyy, kxy]; or resonance_Hz"""
    damping_N_s_per_m: Damping
    """[dxx, dyy, dxy]; or q, or decay_time_s"""
    temperature_K: NonNegative = 300.0
    """of the Brownian force; 0 switches it off"""
    position_m: Pair
    """[x, y] at tick 0"""
    velocity_mps: Pair = (0.0, 0.0)
    """[vx, vy] at tick 0"""
    bias_flicker_rad_s_at_1Hz: NonNegative = 0.0
    """1/f noise of a bias, which turns the pattern and is no rotation: its one-sided density at 1 Hz, rad/s/√Hz"""

    @model_validator(mode="before")
    @classmethod
    def _in_matrices(cls, table: Any) -> Any:
        return in_matrices(table) if isinstance(table, dict) else table

    @model_validator(mode="after")
    def _passive(self) -> "Truth":
        for name in ("stiffness_N_per_m", "damping_N_s_per_m"):
            xx, yy, xy = getattr(self, name)
            if xy * xy > xx * yy:
                raise ValueError(f"{name}: a matrix [xx, yy, xy] that could add energy; xy² must be at most xx yy")
        return self


class Readout(Section):
    """What every sense chain has: slow offsets, noise and a converter behind it."""

    drift_V_per_s: PerAxis = (0.0, 0.0)
    """of the sense output"""
    random_walk_V_per_rts: NonNegative = 0.0
    """of the sense output"""
    noise_V: NonNegative
    """white noise of a sample, rms"""
    flicker_V_at_1Hz: NonNegative = 0.0
    """1/f noise: its one-sided density at 1 Hz, V/√Hz"""
    adc_bits: Annotated[int, Field(ge=4, le=24)]
    """of the sense converter"""
    adc_full_scale_V: Positive
    """its range is ± this"""


class Sense(Readout):
    """`[sense]`: comb capacitors into charge integrators into a converter, equations (3) to (5)."""

    kind: Literal["comb"] = "comb"
    """what reads the motion"""
    fingers: PerAxisPositive
    """N, number of comb fingers"""
    permittivity_F_per_m: Positive = 8.8541878128e-12
    """ε of the gap"""
    width_m: PerAxisPositive
    """W, of a finger"""
    gap_m: PerAxisPositive
    """Z, between fingers"""
    overlap_m: PerAxisPositive
    """of the fingers at rest: C = N ε (W/Z) overlap"""
    mismatch_m: PerAxis = (0.0, 0.0)
    """d, half the difference of the two overlaps at rest"""
    bias_V: Positive
    """±V on the two capacitors"""
    feedback_F: PerAxisPositive
    """Cf of the charge integrator"""
    feedback_ohm: PerAxisPositiveOrInf = (math.inf, math.inf)
    """Rf beside it"""
    parasitic_F: PerAxisNonNegative = (0.0, 0.0)
    """Cp at its input"""
    opamp_offset_V: PerAxis = (0.0, 0.0)
    """Vos"""
    low_pass_Hz: PerAxisPositiveOrInf = (math.inf, math.inf)
    """corner of a first-order low-pass"""


class Piezo(Readout):
    """`[sense]` with `kind = "piezo"`: piezoelectric layers into current amplifiers, which show the velocity:
    Vo + Rf Cf V̇o = -Rf η ẋ + (1 + Rf/Rs) Vos + Rf Ib."""

    kind: Literal["piezo"]
    """what reads the motion"""
    charge_C_per_m: PerAxisPositive
    """η, charge that a displacement sets free"""
    feedback_ohm: PerAxisPositive
    """Rf of the current amplifier"""
    feedback_F: PerAxisNonNegative = (0.0, 0.0)
    """Cf beside it: the gain falls from the corner 1/(2π Rf Cf) on; 0: no corner"""
    source_ohm: PerAxisPositiveOrInf = (math.inf, math.inf)
    """Rs, leakage of the layer"""
    opamp_offset_V: PerAxis = (0.0, 0.0)
    """Vos"""
    bias_A: PerAxis = (0.0, 0.0)
    """Ib, into the amplifier"""


class _Curved(Readout):
    """What the chains below have in common: a map that acts on the motion, and an offset behind it."""

    offset_V: PerAxis = (0.0, 0.0)
    """of the sense output, of any cause"""


class GapClosing(_Curved):
    """`[sense]` with `kind = "gap_closing"`: two plates about a third that moves, charge integrators behind them:
    Vo = -(V/Cf) ε A (1/(Z - x) - 1/(Z + x))."""

    kind: Literal["gap_closing"]
    """what reads the motion"""
    area_m2: PerAxisPositive
    """A, of a plate"""
    gap_m: PerAxisPositive
    """Z, at rest; a plate touches where the displacement is this"""
    permittivity_F_per_m: Positive = 8.8541878128e-12
    """ε of the gap"""
    bias_V: Positive
    """±V on the two plates"""
    feedback_F: PerAxisPositive
    """Cf of the charge integrator"""


class Optical(_Curved):
    """`[sense]` with `kind = "optical"`: a spot on a camera, behind a lens that distorts along the radius:
    px = (M/p) x (1 + κ r²); a volt of the other keys is a pixel."""

    kind: Literal["optical"]
    """what reads the motion"""
    magnification: PerAxisPositive
    """M, image over object"""
    pixel_m: PerAxisPositive
    """p, pitch of the pixels"""
    distortion_per_m2: PerAxis = (0.0, 0.0)
    """κ, of the displacement"""


class Piezoresistive(_Curved):
    """`[sense]` with `kind = "piezoresistive"`: strain gauges in a bridge: Vo = -Vs G (1 + α (T - T0)) s x."""

    kind: Literal["piezoresistive"]
    """what reads the motion"""
    supply_V: Positive
    """Vs, of the bridge, gain behind it included"""
    gauge_factor: PerAxisPositive
    """G at the temperature of tick 0"""
    strain_per_m: PerAxisPositive
    """s, strain of a gauge for a displacement"""
    temperature_per_K: PerAxis = (0.0, 0.0)
    """α, by which the gauge factor follows [temperature]"""


class Tunnelling(_Curved):
    """`[sense]` with `kind = "tunnelling"`: a tip before the mass: Vo = -Rf I0 (exp(a x) - 1), with shot noise
    √(2 q I fs/2) in the current."""

    kind: Literal["tunnelling"]
    """what reads the motion"""
    current_A: PerAxisPositive
    """I0, at rest"""
    decay_per_m: PerAxisPositive
    """a, of the current over the distance"""
    feedback_ohm: PerAxisPositive
    """Rf of the current amplifier"""


def _readout(table: Any) -> Any:
    """Which chain a table is of: combs, where it does not say."""
    return table.get("kind", "comb") if isinstance(table, dict) else getattr(table, "kind", "comb")


class Drive(Section):
    """`[drive]`: the converter and amplifier that push the mass, in force per unit mass."""

    dac_bits: Annotated[int, Field(ge=4, le=24)]
    """of the drive converter"""
    full_scale_mps2: Positive
    """its range is ± this, force per mass"""
    latency_samples: Annotated[int, Field(ge=0, le=MAX_LATENCY_SAMPLES)]
    """samples from a row of SENSE to the tick at which its answer acts"""
    noise_mps2_per_rtHz: NonNegative = 0.0
    """of the amplifier, one-sided density"""
    flicker_mps2_at_1Hz: NonNegative = 0.0
    """1/f noise of the amplifier: its one-sided density at 1 Hz, m/s²/√Hz"""


class Board(Section):
    """`[board]`: what IDENTITY tells."""

    sample_rate_Hz: Positive
    """ticks a second"""
    unique_id: Annotated[int, Field(ge=0, lt=1 << 64)]
    """serial number"""
    firmware: Annotated[int, Field(ge=0, lt=1 << 32)]
    """version, 0xMMmmpppp"""


class Scenario(Section):
    """A whole scenario file."""

    seed: Annotated[int, Field(ge=0, lt=2**63)]
    """of all noise and faults; the same seed gives the same record in lockstep"""
    truth: Truth
    sense: Annotated[
        Annotated[Sense, Tag("comb")]
        | Annotated[Piezo, Tag("piezo")]
        | Annotated[GapClosing, Tag("gap_closing")]
        | Annotated[Optical, Tag("optical")]
        | Annotated[Piezoresistive, Tag("piezoresistive")]
        | Annotated[Tunnelling, Tag("tunnelling")],
        Discriminator(_readout),
    ]
    drive: Drive
    board: Board
    rate: Rate
    temperature: Temperature = Temperature()
    effect: list[Annotated[effects.HiddenEffect, PlainValidator(effects.parse)]] = Field(default_factory=list)
    trim: Annotated[list[Trim], Field(max_length=MAX_TRIMS)] = Field(default_factory=list)
    faults: Faults = Field(default_factory=Faults)

    @model_validator(mode="after")
    def _within_the_model(self) -> "Scenario":
        for name in ("sense_delay", "drive_delay"):
            delay = effects.delay_s(self.effect, name)
            if min(delay) < 0.0 or max(delay) * self.board.sample_rate_Hz > MAX_DELAY_SAMPLES:
                raise ValueError(f"effect {name}: expected 0 to {MAX_DELAY_SAMPLES} samples")
        if (finding := _beyond(self)) is not None:
            raise ValueError(finding)
        if isinstance(self.sense, GapClosing) and math.hypot(*self.truth.position_m) >= min(self.sense.gap_m):
            raise ValueError("sense.gap_m: truth.position_m reaches a plate; expected a wider gap")
        if effects.inner_states(self.effect) > MAX_INNER:
            raise ValueError(f"effect: expected at most {MAX_INNER} states of their own among all of them")
        if len({trim.name for trim in self.trim}) < len(self.trim):
            raise ValueError("trim: expected another name for each output")
        return self

    @property
    def true_rate_Hz(self) -> float:
        """Ticks per second of true time; the board believes in `board.sample_rate_Hz`."""
        return self.board.sample_rate_Hz * (1.0 + self.faults.clock_skew)


def _beyond(scenario: Scenario) -> str | None:
    """The first number with which nothing can be computed: far outside what any device has, a slipped exponent."""
    truth, rate_Hz = scenario.truth, scenario.board.sample_rate_Hz
    stiffest = max(*truth.stiffness_N_per_m, *truth.damping_N_s_per_m) / truth.mass_kg
    least = min(truth.stiffness_N_per_m[:2]) / truth.mass_kg
    turning = [value for key, value in scenario.rate.model_dump().items() if key.endswith("rad_s")]
    fastest = max((abs(float(value)) for value in turning if isinstance(value, int | float)), default=0.0)
    checks = (
        (SLOWEST_HZ <= rate_Hz <= FASTEST_HZ, f"board.sample_rate_Hz: {rate_Hz:g} Hz; the unit is hertz"),
        (
            math.isfinite(stiffest) and (least == 0.0 or 1e-6 * rate_Hz <= math.sqrt(least) <= 1e3 * rate_Hz),
            f"truth.mass_kg: {truth.mass_kg:g} kg on these springs is no oscillator for {rate_Hz:g} samples a second",
        ),
        (max(map(abs, truth.position_m)) <= LARGEST_M, f"truth.position_m: beyond {LARGEST_M:g} m; the unit is metres"),
        (max(map(abs, truth.velocity_mps)) <= LARGEST_MPS, f"truth.velocity_mps: beyond {LARGEST_MPS:g} m/s"),
        (truth.temperature_K <= HOTTEST_K, f"truth.temperature_K: beyond {HOTTEST_K:g} K; the unit is kelvin"),
        (
            fastest <= LARGEST_RAD_S,
            f"rate: {fastest:g} rad/s is beyond {LARGEST_RAD_S:g}; the unit is rad/s",
        ),
    )
    return next((text for held, text in checks if not held), None)


def load(path: Path, *, latency_ticks: int | None = None, rate_Hz: float | None = None) -> Scenario:
    """The scenario in a TOML file, the board with another latency or sample rate where one is given.

    Raises `ScenarioError`: one line with file, key and what was expected.
    """
    try:
        if kind := what_instead(path):
            raise ScenarioError(f"{path}: is {kind}; give a TOML file")
        with path.open("rb") as file:
            raw = file.read(MOST_BYTES + 1)
    except OSError as error:
        raise ScenarioError(f"{path}: cannot read the scenario ({error.strerror})") from None
    if len(raw) > MOST_BYTES:
        raise ScenarioError(f"{path}: longer than {MOST_BYTES >> 20} MB, which no scenario is")
    if said := beyond(raw.decode("utf-8", "replace")):
        raise ScenarioError(f"{path}: not a TOML file that can be used: {said}")
    try:
        document = tomllib.loads(raw.decode("utf-8-sig"))
    except RecursionError:
        raise ScenarioError(f"{path}: not a TOML file: nested too deeply") from None
    except ValueError as error:  # also of bytes that are no text, and of numbers with thousands of digits
        raise ScenarioError(f"{path}: not a TOML file: {error}") from None
    for table, key, given in (("drive", "latency_samples", latency_ticks), ("board", "sample_rate_Hz", rate_Hz)):
        if given is not None and isinstance(document.get(table), dict):
            document[table][key] = given
    rate = document.get("rate")
    if isinstance(rate, dict) and isinstance(rate.get("path"), str):
        rate["path"] = str(path.parent / rate["path"])
    try:
        return Scenario.model_validate(document)
    except ValidationError as error:
        raise ScenarioError(f"{path}: {_one_line(error)}") from None
    except RecursionError:
        raise ScenarioError(f"{path}: nested too deeply") from None


_EXPECTED = {
    "float_type": "a number",
    "int_type": "a whole number",
    "string_type": "a text in quotes",
    "tuple_type": "a list of numbers",
    "list_type": "a list",
    "finite_number": "a finite number",
    "model_type": "a table",
    "model_attributes_type": "a table",
}


def _one_line(error: ValidationError) -> str:
    """The first mistake; an unknown key before a missing one, since it is often the same key misspelt."""
    mistake = min(error.errors(), key=lambda e: e["type"] != "extra_forbidden")
    kind, value, context = mistake["type"], mistake["input"], mistake.get("ctx", {})
    place, known = _place(mistake["loc"])
    if kind == "extra_forbidden":
        return f"{place}: unknown key; {did_you_mean(str(mistake['loc'][-1]), known)}"
    if kind == "missing":
        return f"{place}: missing"
    if kind == "union_tag_not_found":
        return f"{place} kind: missing"
    if kind == "union_tag_invalid":
        tags = context["expected_tags"].replace("'", "").split(", ")
        return f"{place} kind: unknown kind {context['tag']!r}; {did_you_mean(context['tag'], tags)}"
    if kind == "too_long":
        return f"{place}: expected {context['max_length']} numbers, got {context['actual_length']}"
    if "error" in context:  # one of our own validators
        return ": ".join(filter(None, (place, str(context["error"]))))
    expected = _EXPECTED.get(kind) or mistake["msg"].removeprefix("Input should be ")
    return f"{place}: expected {expected}" + ("" if isinstance(value, dict | list | tuple) else f", got {value!r}")


def _place(location: tuple[int | str, ...]) -> tuple[str, list[str]]:
    """`[table.table] key` of an error's location, and the keys that the innermost table knows."""
    tables: list[str] = []
    key = ""
    sections: list[type[Section]] = [Scenario]
    for part in location:
        field = next((s.model_fields[part] for s in sections if part in s.model_fields), None)
        if isinstance(part, int):
            if key:
                key += f" {part + 1}"
            else:
                tables[-1] += f" {part + 1}"
        elif field is None:
            chosen = [s for s in sections if part in _kinds(s)]
            sections = chosen or sections
            key = "" if chosen else part
        elif below := _sections_in(field.annotation):
            sections = below
            tables.append(part)
        else:
            key = part
    table = f"[{'.'.join(tables)}]" if tables else ""
    names = [name for section in sections for name in (*section.model_fields, *section.other_keys())]
    return f"{table} {key}".strip(), [*names, *(KEYS if Truth in sections else ())]


def _kinds(section: type[Section]) -> tuple[Any, ...]:
    """Names by which a choice of sections tells this one apart; empty where there is no choice."""
    return get_args(section.model_fields["kind"].annotation) if "kind" in section.model_fields else ()


def _sections_in(annotation: Any) -> list[type[Section]]:
    if isinstance(annotation, type) and issubclass(annotation, Section):
        return [annotation]
    return [section for inner in get_args(annotation) for section in _sections_in(inner)]
