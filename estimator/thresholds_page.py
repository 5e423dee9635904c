"""The reference page of thresholds, written from their declarations: `python -m estimator.thresholds_page`."""

from dataclasses import fields

from estimator.thresholds import THRESHOLDS, Threshold, each

_INTRODUCTION = """\
# Thresholds of tracing a single axis

Every number that someone has set, with its reason. They are the same for all records and no option changes them; a
`diagnosis.json` keeps those it was made with under `thresholds`. Those of two axes are [checks](trace.md#checks).
Generated: `python -m estimator.thresholds_page`.
"""


def page() -> str:
    """The whole page in Markdown."""
    return _INTRODUCTION + "".join(_section(group.name) for group in fields(THRESHOLDS))


def _section(group: str) -> str:
    said = (type(getattr(THRESHOLDS, group)).__doc__ or "").strip()
    lines = [f"\n## {group}\n\n{said}\n", "| name | value | unit | reason |", "|---|---|---|---|"]
    lines += [_row(one) for one in each(THRESHOLDS) if one.name.startswith(f"{group}.")]
    return "\n".join(lines) + "\n"


def _row(one: Threshold) -> str:
    value = ", ".join(map(_shown, one.value)) if isinstance(one.value, tuple) else _shown(one.value)
    return f"| `{one.name.partition('.')[2]}` | {value} | {one.unit} | {one.reason} |"


def _shown(value: float) -> str:
    return f"{value:,}" if isinstance(value, int) else f"{value:.4g}"


if __name__ == "__main__":
    print(page(), end="")
