"""Effects written into a bench file that exists: text is added, the rest of the file stays as it is."""

import math
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from estimator.errors import ModelError
from hil.bench import Bench
from hil.bench.effects import OwnCoefficient, OwnEffect, OwnParameter, own_table
from hil.errors import InputError
from hil.records.atomic import write_text
from hil.records.diagnosis import Coefficient, Diagnosis, MissingForce
from hil.toml.reading import parse_table, table_of, toml_key, toml_value
from hil.wire.link_name import Emulated, parse_link

_COLUMN = 36  # where the remarks begin


@dataclass(frozen=True)
class Addition:
    """An effect to declare: a remark, and its coefficients (SI per unit mass) with a remark each."""

    name: str
    remark: str
    coefficients: Mapping[str, tuple[float, str]]


def additions(diagnosis: Diagnosis) -> list[Addition]:
    """What to write into the bench file so that the next run has the effects that were found."""
    if diagnosis.verdict != "explained" or diagnosis.fault:
        return []
    return [
        Addition(
            effect.name,
            f"{effect.title}; traced in {diagnosis.record}",
            {
                symbol: (_rounded(found), f"95 %: {_ends(found)} {found.unit}")
                for symbol, found in effect.coefficients.items()
            },
        )
        for effect in diagnosis.effects
    ]


class Added(NamedTuple):
    """The names that a bench file declares now, none where it was not written, and a sentence for the user."""

    names: list[str]
    told: str


def add_found(diagnosis: Diagnosis, source: Path, target: Path) -> Added:
    """Write the bench file `source` to `target` with what was found: the effects, or else the form of the missing
    force.  Raises InputError as `add_effects` and `add_form`.
    """
    if diagnosis.fault:
        return Added([], f"{target}: not written; {diagnosis.reasons[0]}")
    if found := additions(diagnosis):
        add_effects(source, target, found)
        names = [one.name for one in found]
        return Added(names, f"{target}: written; it declares {', '.join(names)}")
    missing = diagnosis.missing_force
    names, unwritten = ([], []) if missing is None else add_form(source, target, missing, diagnosis.record)
    memory = f"; {', '.join(unwritten)} has a memory, which [effects.custom] cannot express" if unwritten else ""
    if names:
        named = ", ".join(f"[effects.{'custom.' * name.startswith('form_')}{name}]" for name in names)
        words = f"written; no effect explains the missing force, so the file declares its form: {named}"
    else:
        zero = missing is not None and missing.form and not unwritten
        words = f"not written; there is nothing to add{': no term of the form is significant' if zero else ''}"
    return Added(names, f"{target}: {words}{memory}")


def add_effects(source: Path, target: Path, additions: Iterable[Addition]) -> None:
    """Write the bench file `source` with `additions` in [effects] to `target`.

    A board that `source` names beside itself is still found from where `target` lies.  InputError when the file already
    declares one of them, or has [effects] in a form that nothing can be added to.
    """
    text = source.read_text(encoding="utf-8")
    before = tomllib.loads(text)
    wanted = {one.name: {key: value for key, (value, _) in one.coefficients.items()} for one in additions}
    if declared := sorted(set(wanted) & set(before.get("effects", {}))):
        raise InputError(
            f"{source}: [effects.{declared[0]}] is declared already; remove it, or start from another file"
        )
    text, expected = _with_board(text, before, source, target)
    text = text.rstrip("\n") + "\n" + "".join(map(_table, additions))
    expected["effects"] = {**expected.get("effects", {}), **wanted}
    try:
        after = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        after = {}
    if after != expected:
        raise InputError(f"{source}: [effects] has a form that nothing can be added to; write one table per effect")
    parse_table(after, Bench, str(target))
    write_text(target, text)


def add_form(source: Path, target: Path, missing: MissingForce, record: str) -> tuple[list[str], list[str]]:
    """Write the bench file `source` with the form of the missing force to `target`, a [effects.custom] for each term
    that is no effect of the catalogue.

    record: on which it was found.  Gives the names that were written, and the terms that were not, as that grammar has
    no memory; a term of which each coefficient may as well be zero is left out.  Where nothing can be written, `target`
    is not.  InputError as of `write_custom`.
    """
    text, remark = source.read_text(encoding="utf-8"), f"a form, no cause; traced in {record}"
    written: list[str] = []
    for term in (one for one in missing.form if one.declarable and one.effect not in written):
        if term.effect:
            numbers = {**term.coefficients, **term.inside}
            given = {symbol: (_rounded(one), f"95 %: {_ends(one)} {one.unit}") for symbol, one in numbers.items()}
            text = text.rstrip("\n") + "\n" + _table(Addition(term.effect, remark, given))
            written.append(term.effect)
            continue
        symbols = {label: f"c_{label.replace(' ', '_')}" for label in term.coefficients}
        along = [
            " + ".join(f"{symbols[label]}*({laws[axis]})" for label, laws in term.laws.items() if laws[axis])
            for axis in (0, 1)
        ]
        name = f"form_{1 + sum(one.startswith('form_') for one in written)}"
        turns = any("sign(" in law for law in along)
        text = write_custom(
            text,
            name,
            () if term.sensed else along,
            {symbols[label]: (_rounded(one), one.unit) for label, one in term.coefficients.items()},
            sensed=along if term.sensed else (),
            parameters={} if turns else {symbol: (one.value or 0.0, one.unit) for symbol, one in term.inside.items()},
            title=f"{'Sensed' if term.sensed else 'Force'} of the form {term.form}",
            remark=remark,
        )
        if turns:  # the number inside is that at which a direction turns over, which the grammar has as v_rest
            (rest,) = term.inside.values()
            text += f"\n[effects.{name}]\nv_rest = {toml_value(rest.value or 0.0)}\n"
        written.append(name)
    if written:
        text, expected = _with_board(text, tomllib.loads(text), source, target)
        parse_table(expected, Bench, str(target))
        write_text(target, text)
    return written, [term.form for term in missing.form if not term.laws and not term.effect]


def write_custom(
    bench_text: str,
    name: str,
    forces: Sequence[str],
    coefficients: Mapping[str, tuple[float, str]],
    *,
    sensed: Sequence[str] = (),
    parameters: Mapping[str, tuple[float, str]] | None = None,
    title: str = "",
    remark: str = "",
) -> str:
    """`bench_text` with the effect [effects.custom.NAME] added, which the next run carries; the rest stays.

    forces: laws of the force per unit mass along x and y in the grammar of [effects.custom], "" where there is none;
    sensed: laws of what is added to the sensed displacement, alike; coefficients: initial value (SI per unit mass) and
    unit of each; parameters: value and unit.  Raises InputError for a law or a unit that is none, for a name that is
    declared already, and for a file that nothing can be added to.
    """
    place = f"[effects.custom.{name}]"
    before = table_of(bench_text.encode(), "bench file")
    effects = before.get("effects", {})
    if name in effects or name in effects.get("custom", {}):
        raise InputError(f"{place} is declared already; take another name")
    force_x, force_y, *_ = (*forces, "", "")
    sense_x, sense_y, *_ = (*sensed, "", "")
    own = OwnEffect(
        title=title,
        force_x=force_x,
        force_y=force_y,
        sense_x=sense_x,
        sense_y=sense_y,
        parameters={key: OwnParameter(unit=unit, value=value) for key, (value, unit) in (parameters or {}).items()},
        coefficients={key: OwnCoefficient(unit=unit, start=start) for key, (start, unit) in coefficients.items()},
    )
    try:
        own.declared(name)
    except ModelError as error:
        raise InputError(f"{place} {error}") from None
    head, *rows = own_table(name, own)
    lines = [head.ljust(_COLUMN) + f"  # {remark}" if remark else head, *rows]
    text = bench_text.rstrip("\n") + "\n\n" + "\n".join(lines) + "\n"
    expected = {**effects, "custom": {**effects.get("custom", {}), name: own.model_dump(exclude_defaults=True)}}
    try:
        after = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        after = {}
    if after != {**before, "effects": expected}:
        raise InputError(f"{place} cannot be added; write [effects] as one table per effect")
    return text


def _with_board(text: str, table: dict[str, Any], source: Path, target: Path) -> tuple[str, dict[str, Any]]:
    """The text, and what it says, with the scenario beside `source` named by its path, where `target` is elsewhere."""
    link = table.get("link")
    url = link.get("url") if isinstance(link, dict) else None
    if not isinstance(link, dict) or not isinstance(url, str):
        return text, table
    place = parse_link(url)
    if source.parent.resolve() == target.parent.resolve() or not isinstance(place, Emulated):
        return text, table
    if not (source.parent / place.scenario).is_file():
        return text, table
    moved = replace(place, scenario=str((source.parent / place.scenario).resolve())).url
    return text.replace(toml_value(url), toml_value(moved), 1), {**table, "link": {**link, "url": moved}}


def _table(addition: Addition) -> str:
    rows = [(f"[effects.{toml_key(addition.name)}]", addition.remark)]
    rows += [
        (f"{toml_key(key)} = {toml_value(value)}", remark) for key, (value, remark) in addition.coefficients.items()
    ]
    return "\n" + "".join((line.ljust(_COLUMN) + f"  # {remark}" if remark else line) + "\n" for line, remark in rows)


def _rounded(found: Coefficient) -> float:
    """The estimate to a hundredth of its interval: what is behind that is noise."""
    value, (low, high) = found.value or 0.0, found.ci95
    if low is None or high is None or not high > low:
        return float(f"{value:.10g}")
    return float(f"{round(value, 2 - math.floor(math.log10(high - low))):.15g}")


def _ends(found: Coefficient) -> str:
    low, high = found.ci95
    if found.value is None or low is None or high is None:
        return " to ".join("unbounded" if end is None else f"{end:.4g}" for end in (low, high))
    return f"± {max(high - found.value, found.value - low):.2g}"
