"""Effects written into a bench file that exists: text is added, the rest of the file stays as it is."""

import math
import re
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hil.bench import Bench
from hil.bench.text import toml_value
from hil.emulation import is_emulated, located
from hil.errors import InputError
from hil.records.atomic import write_text
from hil.records.diagnosis import Coefficient, Diagnosis
from hil.strict_toml import parse_table

_COLUMN = 36  # where the remarks begin


@dataclass(frozen=True)
class Addition:
    """An effect to declare: a remark, and its coefficients (SI per unit mass) with a remark each."""

    name: str
    remark: str
    coefficients: Mapping[str, tuple[float, str]]


def additions(diagnosis: Diagnosis) -> list[Addition]:
    """What to write into the bench file so that the next run has the effects that were found."""
    if diagnosis.verdict != "explained":
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


def _with_board(text: str, table: dict[str, Any], source: Path, target: Path) -> tuple[str, dict[str, Any]]:
    """The text, and what it says, with the scenario beside `source` named by its path, where `target` is elsewhere."""
    link = table.get("link")
    url = link.get("url") if isinstance(link, dict) else None
    if not isinstance(link, dict) or not isinstance(url, str) or not is_emulated(url):
        return text, table
    kind, _, place = url.partition(":")
    if source.parent.resolve() == target.parent.resolve() or not (source.parent / place).is_file():
        return text, table
    path = Path(located(url, beside=source).partition(":")[2]).resolve()
    moved = f"{kind}:{path}"
    return text.replace(toml_value(url), toml_value(moved), 1), {**table, "link": {**link, "url": moved}}


def _table(addition: Addition) -> str:
    rows = [(f"[effects.{_key(addition.name)}]", addition.remark)]
    rows += [(f"{_key(key)} = {toml_value(value)}", remark) for key, (value, remark) in addition.coefficients.items()]
    return "\n" + "".join((line.ljust(_COLUMN) + f"  # {remark}" if remark else line) + "\n" for line, remark in rows)


def _key(name: str) -> str:
    """A key of TOML: in quotes where it is not bare, as `interference:2` is not."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else toml_value(name)


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
