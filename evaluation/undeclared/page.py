"""evaluation/results/undeclared.md and its confusion matrix."""

from collections.abc import Mapping, Sequence, Set
from pathlib import Path
from typing import Any

from evaluation.undeclared.effects import EFFECTS
from evaluation.undeclared.judging import NOTHING, Judgement
from evaluation.undeclared.summary import ratios
from hil.records.atomic import write_text

_INK, _PAPER, _RIGHT, _WRONG = "#1b2530", "#ffffff", "#1d5fa6", "#b3261e"


def write_page(folder: Path, summary: Mapping[str, Any], judged: Sequence[Judgement]) -> None:
    """Write `undeclared.md` and `undeclared.svg` into `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    right = {(j.row, j.column) for j in judged if j.right}
    _draw(folder / "undeclared.svg", summary["confusion"], right)
    write_text(folder / "undeclared.md", _page(summary, judged))


def _page(summary: Mapping[str, Any], judged: Sequence[Judgement]) -> str:
    one, two, out, calm = (summary[key] for key in ("single", "double", "outside", "calm"))
    broken, explained = len(summary["broken"]), sum(j.verdict == "explained" for j in judged)
    figures = [
        ("one effect: its class named first", one["named_first"], one["n"], "97 %"),
        (
            "… and where the record tells its members apart: the member",
            one["member_first_where_told_apart"],
            one["told_apart"],
            "95 %",
        ),
        ("… and another effect named beside it", one["surplus"], one["n"], ""),
        ("… innovation on the held-out part within 2 % of the true noise", one["down_to_noise"], one["n"], ""),
        ("no effect: adequate", summary["clean"]["adequate"], summary["clean"]["n"], "98 %"),
        ("… innovation within 2 % of the true noise", summary["clean"]["down_to_noise"], summary["clean"]["n"], ""),
        ("an effect outside the catalogue: not explained", out["not_explained"], out["n"], "98 %"),
        ("… unexplained", out["unexplained"], out["n"], ""),
        ("two effects: both named", two["both_named"], two["n"], "92 %"),
        ("single-tone records: class named, or adequate with a bound that holds", calm["right"], calm["n"], "95 %"),
        ("… a wrong name, without reserve", calm["misnamed"], calm["n"], "≤ 2 %"),
        ("what no record shows: adequate", summary["never"]["adequate"], summary["never"]["n"], ""),
        ("explained, and the innovation held out rose or is above 1.1 × its floor", broken, explained, "none"),
    ]
    lines = [
        "# Undeclared effects",
        "",
        "Emulated records of random devices, each with an effect that nobody declared, traced without the truth and",
        "judged by it. Written by `make undeclared`; how, in `evaluation/undeclared`.",
        "",
        "| | of | | wanted |",
        "|---|---|---|---|",
        *(f"| {what} | {hit} of {n} | {_percent(hit, n)} | {wanted} |" for what, hit, n, wanted in figures),
        f"| 95 % intervals that hold the truth, one effect | {one['coefficients']} intervals "
        f"| {_share(one['coverage'])} | 92–97 % |",
        f"| 95 % intervals that hold the truth, two effects | | {_share(two['coverage'])} | |",
        *(
            f"| {what} | {summary[key]['n']} statements | {_plain(summary[key]['error'])} | ≤ 0.05 |"
            for what, key in (
                ("stated probabilities: expected calibration error", "calibration"),
                ("… of records that are excited", "calibration_excited"),
                ("… of single-tone records", "calibration_calm"),
            )
        ),
        "",
        "What keeps the innovation above the true noise is the rate: it moves as nobody could predict, and the",
        "observer has to allow for it. Records with nothing hidden have the same few per cent.",
        "",
        "![What was hidden, in rows, and what was named first, in columns](undeclared.svg)",
        "",
        "Size is stated without units: in amplitudes, in k A, in radians of the vibration. Innovation is that of the",
        "observer in the loop, which did not know the effect, over the true noise: smallest, median, largest.",
        "",
        "| hidden | size | why this range | innovation |",
        "|---|---|---|---|",
        *_ranges(judged),
        "",
    ]
    return "\n".join(lines)


def _ranges(judged: Sequence[Judgement]) -> list[str]:
    seen = ratios(j for j in judged if len(j.truth) <= 1 and j.category != "calm")
    rows = []
    for name, (low, middle, high) in seen.items():
        drawable = EFFECTS.get(name)
        size, why = (f"{drawable.low:g} to {drawable.largest:g}", drawable.why) if drawable else ("", "")
        rows.append(f"| {name} | {size} | {why} | {low:.3g}, {middle:.3g}, {high:.3g} |")
    return rows


def _percent(hit: int, n: int) -> str:
    return f"{100.0 * hit / n:.1f} %" if n else "–"


def _share(value: float | None) -> str:
    return "–" if value is None else f"{100.0 * value:.1f} %"


def _plain(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}"


def _draw(path: Path, confusion: Mapping[str, Mapping[str, int]], right: Set[tuple[str, str]]) -> None:
    """The confusion matrix: each row's shares as shades, counts as figures; blue what is right, red a wrong name."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    verdicts = ["adequate", "partly explained", "unexplained", "refused"]
    rows = sorted(confusion, key=lambda row: (row == NOTHING, row))
    named = {column for counts in confusion.values() for column in counts}
    columns = [row for row in rows if row in named]
    columns += sorted(named - set(columns) - set(verdicts)) + [verdict for verdict in verdicts if verdict in named]
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "undeclared", "font.size": 7}):
        figure = Figure(figsize=(1.8 + 0.24 * len(columns), 1.8 + 0.19 * len(rows)), layout="constrained")
        axes = figure.add_subplot()
        for y, row in enumerate(rows):
            total = sum(confusion[row].values())
            for x, column in enumerate(columns):
                count = confusion[row].get(column, 0)
                if count:
                    shade = count / total
                    colour = _RIGHT if (row, column) in right else _WRONG if column not in verdicts else _INK
                    axes.add_patch(mpl.patches.Rectangle((x - 0.5, y - 0.5), 1, 1, color=colour, alpha=shade, lw=0))
                    ink = _PAPER if shade > 0.5 else _INK
                    axes.text(x, y, str(count), ha="center", va="center", color=ink)
        axes.set_xlim(-0.5, len(columns) - 0.5)
        axes.set_ylim(len(rows) - 0.5, -0.5)
        axes.set_xticks(range(len(columns)), columns, rotation=90)
        axes.set_yticks(range(len(rows)), rows)
        axes.set_xlabel("named first, or verdict")
        axes.set_ylabel("hidden")
        axes.tick_params(length=0)
        for side in axes.spines.values():
            side.set_visible(False)
        figure.savefig(path, metadata={"Date": None})
