"""The reference page of scenario files, written from their declarations.

`python -m device_emulator.page > docs/reference/scenario.md` writes it.
"""

import math
import types
from collections.abc import Iterator
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic.fields import FieldInfo

from device_emulator import rate
from device_emulator.faults import Faults, Saturated, Spell, Stuck
from device_emulator.modes import KEYS
from device_emulator.scenario import Board, Drive, Piezo, Scenario, Sense, Truth
from device_emulator.section import Section, both_axes
from device_emulator.temperature import Temperature

_INTRODUCTION = """\
# Scenario file

What an emulated board really is: TOML, UTF-8, SI units with the unit in the key's name. `hil emulate FILE` and
`pty:FILE` start a board from it. The host never opens it: it knows the [bench file](bench.md), which declares what a
data sheet would say. Keys marked **required** must be given; unknown keys are errors, each in one line. Where a key
has a value for each axis, one number is for both, `[x, y]` for each.

Angles and rates may be in degrees: `rate_dps` for `rate_rad_s`, `phase_deg` for `phase_rad`. Give a quantity once.

The shortest one, of a device at 200 Hz with a Q of 1000 and a split of 4 Hz; others stand in `examples/`:

```toml
{example}```

Generated: `python -m device_emulator.page > docs/reference/scenario.md`.
"""

EXAMPLE = """\
seed = 1

[truth]
mass_kg = 1e-3
resonance_Hz = 200.0
split_Hz = 4.0
azimuth_deg = 15.0
q = 1000.0
position_m = [1e-4, 0.0]

[sense]                       # -885 V/m
fingers = 100
width_m = 2e-6
gap_m = 2e-6
overlap_m = 2e-4
bias_V = 5.0
feedback_F = 1e-11
noise_V = 9e-5
adc_bits = 16
adc_full_scale_V = 0.25

[drive]
dac_bits = 16
full_scale_mps2 = 10.0
latency_samples = 1

[board]
sample_rate_Hz = 4000.0
unique_id = 1
firmware = 0x00010000

[rate]
kind = "constant"
rate_dps = 90.0
"""

_MODES = """
### In place of stiffness and damping

A resonance f with a split s is f + s/2 along the azimuth and f - s/2 across it; Q = π f τ with the decay time τ of the
amplitude.

| key | meaning |
|---|---|
"""

_RATE = """
## [rate]

How the board is turned. `kind` says which of these it is.
"""

_EFFECT = """
## [[effect]]

What the board has and its data sheet does not declare: `name`, and the coefficients of the effect.
[All of them](hidden-effects.md).
"""

_TABLES: tuple[tuple[str, type[Section]], ...] = (
    ("[truth]", Truth), ("[sense]", Sense), ('[sense], kind = "piezo"', Piezo), ("[drive]", Drive), ("[board]", Board),
)  # fmt: skip
_RATES: tuple[tuple[str, type[Section]], ...] = (
    ("constant", rate.Constant), ("steps", rate.Steps), ("sine", rate.Sine), ("ramp", rate.Ramp),
    ("segments", rate.Segments), ("file", rate.FromFile),
)  # fmt: skip
_SPELLS: tuple[tuple[str, type[Section]], ...] = (
    ("[[faults.stall]], [[faults.brown_out]], [[faults.tripped]]", Spell), ("[[faults.stuck]]", Stuck),
    ("[[faults.saturated]]", Saturated),
)  # fmt: skip


def page() -> str:
    """The whole page in Markdown."""
    parts = [_INTRODUCTION.format(example=EXAMPLE), "\n## At the top\n", *_table(Scenario, only=("seed",))]
    for name, section in _TABLES:
        parts += [f"\n## {name}\n\n{_told(section)}\n", *_table(section)]
        if section is Truth:
            parts += [_MODES, *(f"| `{key}` | {meaning} |\n" for key, meaning in KEYS.items())]
    parts.append(_RATE)
    for kind, section in _RATES:
        parts += [f'\n### kind = "{kind}"\n\n{_told(section)}\n', *_table(section)]
    parts += [f"\n## [temperature]\n\n{_told(Temperature)}\n", *_table(Temperature), _EFFECT]
    parts += [f"\n## [faults]\n\n{_told(Faults)} [How faults act](faults.md).\n", *_table(Faults)]
    for name, section in _SPELLS:
        parts += [f"\n### {name}\n\n{_told(section)}\n", *_table(section)]
    return "".join(parts)


def _told(section: type[Section]) -> str:
    text = " ".join((section.__doc__ or "").split())
    told = text.partition("`: ")[2] or text
    return told[:1].upper() + told[1:]


def _table(section: type[Section], only: tuple[str, ...] = ()) -> Iterator[str]:
    yield "\n| key | value | default | meaning |\n|---|---|---|---|\n"
    others = {field: other for other, field in section.other_keys().items()}
    for key, field in section.model_fields.items():
        if key == "kind" or (only and key not in only):
            continue
        other = f"; or `{others[key]}`" if key in others else ""
        meaning = " ".join((field.description or "").split())
        yield f"| `{key}` | {_kind(field)} | {_default(field)} | {meaning}{other} |\n"


def _kind(field: FieldInfo) -> str:
    bounds = list(_bounds(field.metadata)) or list(_bounds_within(field.annotation))
    one_will_do = any(getattr(rule, "func", None) is both_axes for rule in field.metadata)
    word = "number or [x, y]" if one_will_do else _word(field.annotation)
    return " ".join(filter(None, [word, ", ".join(dict.fromkeys(bounds))]))


def _word(annotation: Any) -> str:
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _word(inner[0])
    if origin in (Union, types.UnionType):
        return _word(next(one for one in inner if one is not type(None)))
    if origin is Literal:
        return " · ".join(f'`"{one}"`' for one in inner)
    if origin is tuple:
        return f"{len(inner)} numbers"
    if origin is list:
        return "list" if inner[0] is float else "tables"
    return {float: "number", int: "whole number", str: "text"}[annotation]


def _bounds(metadata: Any) -> Iterator[str]:
    for one in metadata:
        for name, sign in (("gt", ">"), ("ge", "≥"), ("lt", "<"), ("le", "≤")):
            if (limit := getattr(one, name, None)) is not None:
                yield f"{sign} {limit:g}"
        if hasattr(one, "metadata"):
            yield from _bounds(one.metadata)


def _bounds_within(annotation: Any) -> Iterator[str]:
    """Of the first number in a list of them."""
    inner = get_args(annotation)
    if get_origin(annotation) is Annotated:
        yield from _bounds(inner[1:])
    elif get_origin(annotation) in (tuple, Union, types.UnionType):
        yield from _bounds_within(inner[0])


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "**required**"
    if field.default_factory is not None or field.default is None:
        return "none"
    if isinstance(field.default, str):
        return f'`"{field.default}"`'
    values = field.default if isinstance(field.default, tuple) else (field.default,)
    shown = ["infinite" if isinstance(one, float) and math.isinf(one) else f"{one:g}" for one in values]
    return f"`{shown[0] if len(set(shown)) == 1 else list(values)}`"


if __name__ == "__main__":
    print(page(), end="")
