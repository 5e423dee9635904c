"""The entries of the reference page of effects."""

from estimator.effects.catalogue import EFFECTS
from estimator.effects.declaration import Coefficient, Effect, Parameter, Source
from estimator.effects.equation import equations

_TIME = "t in s, 0 one sample interval before the first sample"
_SIGNALS = {
    Source.COSINE: f"cos(omega t), {_TIME}",
    Source.SINE: f"sin(omega t), {_TIME}",
    Source.TEMPERATURE: "measured temperature, less its first reading; the reading of a sample holds over the interval "
    "that ends with it",
    Source.INTEGRAL: "∫ u{axis} dt, leaking at `{behind}`",
    Source.RESONATOR: "p of p̈ + 2 zeta omega ṗ + omega² p = u{axis}",
    Source.DIRECTION: "tanh(v{axis}/v0)",
    Source.DECAY: "exp(−leak_{axis} t) from the first sample on",
    Source.LAG: "u{axis} behind a first-order lag of {behind}",
    Source.WANE: "exp(−t/{behind}) from the first sample on",
    Source.TIME: f"t, {_TIME}",
    Source.STOP: "{axis} less z, which stays while it is no further from {axis} than {behind}, else follows at that "
    "distance; begins as if {axis} had come from 0",
    Source.SLIP: "z of ż = v{axis} while z and v{axis} differ in sign, else v{axis} (1 − |z|/{behind}); 0 at first",
}


def entries() -> str:
    """A section for each effect."""
    return "\n\n".join(map(_entry, EFFECTS))


def _entry(effect: Effect) -> str:
    lines = [f"## {effect.name}\n\n{effect.title}.\n"]
    lines += [f"- `{equation}`" for equation in equations(effect)]
    named = ", ".join(f"`{p.name}` [{p.unit}]{_choices(p)}" for p in effect.parameters if not _stays(effect, p))
    if effect.declared_only:
        lines.append(f"- parameters, given and never estimated (no record could; no trace names it): {named}")
    else:
        lines.append("- coefficients: " + ", ".join(map(_coefficient, effect.coefficients)))
        if named:
            lines.append(f"- parameters, given and not estimated (a trace searches for them): {named}")
        lines += [
            f"- `{p.name}` [{p.unit}], {p.default:g} A ω0 unless given: neither estimated nor searched for"
            for p in effect.parameters
            if _stays(effect, p)
        ]
        if effect.parameters:
            same = [f"`{p.name}` and `{p.found_as}`" for p in effect.parameters if p.found_as is not None]
            lines += [f"- one number each: {', '.join(same)}"] if same else []
    for signal in effect.signals:
        if signal.source is not Source.PARAMETER:
            meaning = _SIGNALS[signal.source].format(axis="xy"[signal.axis], behind=signal.behind)
            lines.append(f"- `{signal.symbol}`: {meaning}")
    lines.append(f"- signature: {effect.signature}")
    for name, separator in effect.look_alikes.items():
        lines.append(f"- looks like {name.replace('_', ' ')}; told apart: {separator}")
    if effect.runs_freely:
        lines.append("- traced on a single axis only")
    lines.append(f"- compensation: {effect.compensation.value}")
    lines.append(f"- source: {effect.source}")
    return "\n".join(lines)


def _stays(effect: Effect, parameter: Parameter) -> bool:
    """Whether a trace takes it as it is."""
    return parameter.default is not None and not effect.declared_only


def _coefficient(c: Coefficient) -> str:
    return f"`{c.name}` [{c.unit}]" + (" (one for both axes)" if c.is_shape else "")


def _choices(parameter: Parameter) -> str:
    return " " + " or ".join(f"{value:g}" for value in parameter.choices) if parameter.choices else ""
