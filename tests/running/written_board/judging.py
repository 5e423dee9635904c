"""One case of a board that misbehaves: the bench run against it, and held against what the pages promise.

The board (`board.c`) and what is expected of the bench in each case (`expectations.toml`) were written from
docs/wire.md and docs/safety.md by somebody who had not read the bench, before any of them was run.  Whether SAFE came,
and when, is taken from the board's own log and not from what the bench says of itself.
"""

import json
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any, NamedTuple

HERE = Path(__file__).parent
FIELD_TABLE = HERE.parents[2] / "docs" / "reference" / "field-table.tsv"
LIMIT_S = 240.0
"""No run may last longer."""

_AT = "1000"  # tick at which a board begins to misbehave
_EVENTS = ("dead", "rows end", "reboot", "state SAFE", "armed")

Case = dict[str, Any]


def cases() -> dict[str, Case]:
    """Every case by name."""
    found: dict[str, Case] = tomllib.loads((HERE / "expectations.toml").read_text(encoding="utf-8"))["case"]
    return found


def build(folder: Path) -> Path:
    """Compile the board, its field table made of the published one; the program."""
    program = folder / "board"
    table = FIELD_TABLE.read_text(encoding="utf-8").split("\n")
    strings = ",\n".join(json.dumps(line, ensure_ascii=False) for line in table)
    (folder / "field_table.h").write_text(
        f"static const char *const FIELD_TABLE[] = {{\n{strings}}};\n", encoding="utf-8"
    )
    source = [shutil.which("cc") or "cc", "-std=c11", "-O2", "-Wall", "-Wextra", "-Werror", str(HERE / "board.c")]
    subprocess.run([*source, f"-I{folder}", "-o", str(program), "-lm"], check=True)
    return program


class Seen(NamedTuple):
    """What a run left: exit code (None: no end within the limit), terminal, safety part of result.json, board's log."""

    code: int | None
    said: str
    safety: dict[str, Any]
    log: str


def run(program: Path, name: str, case: Case, folder: Path) -> Seen:
    """The bench against the board of a case on a pty, in `folder`, which is made."""
    folder.mkdir(parents=True)
    bench, log = folder / "bench.toml", folder / "board.log"
    bench.write_text(_bench(case), encoding="utf-8")
    begin = [str(program), "--misbehave", case.get("board", name), "--at", _AT, "--log", str(log)]
    with subprocess.Popen(begin, stdout=subprocess.PIPE, text=True) as board:
        assert board.stdout is not None
        try:
            url = board.stdout.readline().split()[1]
            command = [sys.executable, "-m", "hil", "run", str(bench), "--link", url, "--arm", "--out", str(folder)]
            command += ["--clock", case.get("clock", "lockstep")]
            code, said = _ended(command, folder / "said.txt", LIMIT_S)
        finally:
            board.terminate()
    results = list(folder.glob("*/result.json"))
    result = json.loads(results[0].read_text(encoding="utf-8")) if results else {}
    return Seen(code, said, result.get("parts", {}).get("safety", {}), log.read_text(encoding="utf-8"))


def broken(case: Case, seen: Seen) -> list[str]:
    """One line for each expectation of the case that was not met."""
    told = []
    outcome = seen.safety.get("outcome")
    unsafe = outcome == "unsafe" or re.search(r"(?i)\bunsafe\b|cut the supply", seen.said) is not None
    if seen.code not in case["exit"]:
        told.append("no end" if seen.code is None else f"exit {seen.code}, not {case['exit']}")
    if case["outcome"] and outcome and outcome not in case["outcome"]:
        told.append(f"safety {outcome}, not {case['outcome']}")
    if unsafe != case["unsafe"]:
        told.append("unsafe" if unsafe else "not unsafe")
    everything = seen.said + json.dumps(seen.safety, ensure_ascii=False)
    if case.get("names") and not re.search(case["names"].replace("(?i)", ""), everything, re.IGNORECASE):
        told.append(f"does not name {case['names']}")
    if case.get("no_escape") and "\x1b" in seen.said:
        told.append("a control sequence reached the terminal")
    if "Traceback" in seen.said or "fault of hil" in seen.said:
        told.append("traceback")
    return told + _by_the_board(case, seen.log)


def _by_the_board(case: Case, log: str) -> list[str]:
    """What the board itself says of ARM, SAFE and drives."""
    told = []
    events = [(float(line.split()[0]), line.split(" ", 1)[1]) for line in log.splitlines() if " " in line]
    counted = {name: int(value) for name, value in re.findall(r"(\w+) (-?\d+)", events[-1][1])}
    safe = [at for at, event in events if event.startswith("SAFE received")]
    armed = any(event.startswith("arm received") for _, event in events)
    gone = any(event.startswith(("hang up", "exit")) for _, event in events)
    if "armed" in case and armed != case["armed"]:
        told.append("ARM was sent" if armed else "ARM was not sent")
    if (case["safe"] or armed) and not (safe or gone or case.get("safe_may_miss")):
        told.append("the board never got SAFE")
    if counted.get("driven", 0) > case.get("driven", sys.maxsize):
        told.append(f"driven for {counted['driven']} ticks")
    if case.get("within_s") and safe:
        marks = [at for at, event in events if event.startswith(_EVENTS) and at <= safe[0]]
        if marks and safe[0] - marks[-1] > case["within_s"]:
            told.append(f"SAFE came after {safe[0] - marks[-1]:.1f} s")
    return told


def _bench(case: Case) -> str:
    text = (HERE / "bench.toml").read_text(encoding="utf-8")
    keys: dict[str, str] = {}
    if case.get("clock") == "paced":
        keys["watchdog_s"] = "0.5"  # a busy machine stalls for tens of milliseconds
    if case.get("mode") == "gain":
        keys |= {"mode": '"gain"', "block": "40", "watchdog_s": "0.1"}
    for key, value in keys.items():
        text = re.sub(rf"(?m)^{key} = .*", f"{key} = {value}", text)
    return text


def _ended(command: list[str], said: Path, limit_s: float) -> tuple[int | None, str]:
    with said.open("wb") as out:
        process = subprocess.Popen(
            command, stdout=out, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, start_new_session=True
        )
        try:
            code: int | None = process.wait(limit_s)
        except subprocess.TimeoutExpired:
            code = None
            process.terminate()
            try:
                process.wait(20.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
    return code, said.read_text(encoding="utf-8", errors="replace")
