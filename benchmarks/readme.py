"""`python -m benchmarks.readme [README]`: run the before/after commands of the README, and write the table under them.

Each command runs in an empty folder; a run is scored by the truth that it was told to keep. The table stands between
two comments and has the form of `table`; all of it is lockstep, so that any machine gives the same figures.
"""

import json
import re
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

from device_emulator.scenario import load
from hil.bench.examples import find
from hil.errors import InputError
from hil.numbers import plus_minus, significant

BEGIN, END = "<!-- python -m benchmarks.readme -->", "<!-- end -->"
README = Path(__file__).parents[1] / "README.md"
_BLOCK = re.compile(r"^((?: {4}hil .*\n)+)(?:(?! {4}hil ).*\n)*?" + re.escape(BEGIN), re.MULTILINE)


class Found(NamedTuple):
    """result.json of the run before and after, scored, and diagnosis.json between; true coefficients by symbol."""

    before: dict[str, Any]
    diagnosis: dict[str, Any]
    after: dict[str, Any]
    truth: dict[str, float]


def commands(readme: str) -> list[list[str]]:
    """The commands of the last block before the table, each as a list of words."""
    block = _BLOCK.search(readme)
    if block is None:
        raise InputError(f"README.md: no block of hil commands before {BEGIN}; put the comment under one")
    return [shlex.split(line) for line in block[1].splitlines()]


def with_table(readme: str, rows: str) -> str:
    """The README with these rows between the comments."""
    begin, end = readme.index(BEGIN) + len(BEGIN), readme.index(END)
    return f"{readme[:begin]}\n\n{rows}\n\n{readme[end:]}"


def measured(block: list[list[str]]) -> Found:
    """Run the commands; a run, a trace, a run."""
    with tempfile.TemporaryDirectory() as place:
        said = []
        for words in block:
            said.append(_run(words, place))
            if words[1] == "run":
                said[-1] = _run(["hil", "score", "last", "--truth", words[words.index("--truth") + 1]], place)
        scenario = load(find("scenario", block[0][2]))
    truth = {symbol: value for effect in scenario.effect for symbol, value in effect.coefficients.items()}
    before, diagnosis, after = said
    return Found(before, diagnosis, after, truth)


def _run(words: list[str], place: str) -> dict[str, Any]:
    """What a command says with --json; a verdict that failed is an answer, too."""
    print(shlex.join(words), file=sys.stderr, flush=True)
    command = [sys.executable, "-m", "hil", *words[1:], "--json"]
    done = subprocess.run(command, cwd=place, stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode not in (0, 1):
        raise InputError(f"{shlex.join(words)}: exit code {done.returncode}; run it by hand")
    answer: dict[str, Any] = json.loads(done.stdout)
    return answer


def table(found: Found) -> str:
    """The rows, in Markdown."""
    before, diagnosis, after, truth = found
    held_out, turns = diagnosis["held_out"], significant(before["score"]["turns"], 2)
    coefficients = {
        symbol: value for effect in diagnosis["effects"] for symbol, value in effect["coefficients"].items()
    }
    scale = 10.0 ** (3 * (len(str(int(min(map(abs, truth.values()))))) // 3))
    names, unit = ", ".join(coefficients), next(iter(coefficients.values()))["unit"]
    true = " and ".join(f"{truth[symbol] / scale:.4g}" for symbol in coefficients)
    sizes = ", ".join(
        plus_minus(value["value"] / scale, 0.5 * (value["ci95"][1] - value["ci95"][0]) / scale)
        for value in coefficients.values()
    )
    effects = " and ".join(effect["name"].replace("_", " ") for effect in diagnosis["effects"])
    power = f"10{str(len(str(int(scale))) - 1).translate(_RAISED)}"
    rows = [
        ("figure", "before", "after"),
        ("---", "---", "---"),
        (
            "residual over noise floor, on the part held out",
            *(f"{held_out[w]['ratio']:.2f}" for w in ("before", "after")),
        ),
        (f"angle error, rms, in {turns} rotations", *(_milli(one["angle_error_rms_rad"]) for one in (before, after))),
        ("rate error, rms", *(f"{one['rate_error_rms_rad_s']:.3f} rad/s" for one in (before, after))),
        (f"found: {effects} {names} / {power} {unit}, truth {true}", "", sizes),
    ]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows).replace("| --- | --- | --- |", "|---|---|---|")


_RAISED = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")


def _milli(angle_rad: float) -> str:
    return f"{significant(1e3 * angle_rad, 3 if angle_rad > 0.1 else 2)} mrad"


def main() -> None:
    """Write the table into the README given, by default this project's."""
    place = Path(sys.argv[1]) if len(sys.argv) > 1 else README
    try:
        text = place.read_text(encoding="utf-8")
        place.write_text(with_table(text, table(measured(commands(text)))), encoding="utf-8")
    except (InputError, OSError) as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
