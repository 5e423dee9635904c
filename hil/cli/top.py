"""``hil top``: what the board of a service does, in a terminal."""

from pathlib import Path
from typing import Annotated, Any

import typer

from hil.cli.options import RUNS, Json
from hil.numbers import COVERAGE

Url = Annotated[
    str | None, typer.Argument(metavar="[URL]", help="Address with the token, as hil serve prints it; else --folder.")
]
Folder = Annotated[Path, typer.Option("--folder", "-o", help="Folder of runs whose service is shown.")]
Once = Annotated[bool, typer.Option("--once", help="Show it once and end.")]


def top(url: Url = None, folder: Folder = RUNS, once: Once = False, json: Json = False) -> None:
    """Show what the board of a service does: state, angle and rate with their uncertainty, link, drive.

    Ends with Ctrl-C, which only closes the display. The key that brings the board to SAFE is on the page; here
    it is a request: curl -X POST -H "Authorization: Bearer TOKEN" URL/api/board/safe.

    Examples:

    \b
      hil top
      hil top --once --json
      ssh bench hil top --folder /srv/bench/runs
    """
    import hil.client
    from hil.cli.show import print_json

    with hil.client.connect(url, folder=folder) as service:
        if once or json:
            state = next(service.states())
            if json:
                print_json(state)
            else:
                print("\n".join(f"{name:<12} {value}" for name, value in rows(state)))
            return
        _watch(service)


def rows(state: dict[str, Any]) -> list[tuple[str, str]]:
    """What is shown, line by line: name and words."""
    now, health = state.get("now") or {}, state.get("health") or {}
    board = state["state"] or "none is connected"
    told = [("board", f"{board} {state['reason']}".strip()), ("link", state["link"] or "–")]
    if state["words"]:
        told.append(("", state["words"]))
    if state["lease"]:
        lease = state["lease"]
        told.append(
            ("lease", f"{lease['holder']}, {lease['left_s']:.0f} s{', ' * bool(lease['purpose'])}{lease['purpose']}")
        )
    if state["run"] or state["stage"]:
        done = f" {100 * state['done'] / state['total']:.0f} %" if state["total"] else ""
        told.append(("run", f"{state['run'] or ''} {state['stage']}{done}".strip()))
    elif state["last_verdict"]:
        last = state["last_verdict"]
        told.append(("last run", f"{state['last_run']}: {last['verdict']}"))
        told += [(f"  {part}", reason) for part, reason in last["against"].items()]
    if "t_s" in now:
        told.append(("time", f"{now['elapsed_s']:.2f} s of {state['duration_s'] or 0:g} s"))
        told.append(("angle", _with_u(now.get("angle_rad"), now.get("angle_u_rad"), "rad")))
        told.append(("rate", _with_u(now.get("rate_rad_s"), now.get("rate_u"), "rad/s")))
        innovation, drive = now.get("innovation") or {}, now.get("drive") or {}
        if innovation.get("ratio") is not None:
            told.append(
                ("innovation", f"{1e6 * innovation['rms_V']:.3g} µV, {innovation['ratio']:.2f} of what is predicted")
            )
        if drive.get("full_scale"):
            peak = max(drive.get("peak_x", 0.0), drive.get("peak_y", 0.0))
            told.append(("drive", f"peak {100 * peak / drive['full_scale']:.1f} % of full scale"))
    if "samples" in health:
        told.append(
            ("samples", f"{health['samples']}, {health['lost']} lost, {health['held']} without an answer in time")
        )
        turn = health.get("turnaround_us")
        if turn:
            told.append(("turnaround", f"p50 {turn['p50']:.0f} µs, p99 {turn['p99']:.0f} µs, max {turn['max']:.0f} µs"))
        if health["silent_s"] > 0.5:
            told.append(("silent", f"for {health['silent_s']:.1f} s"))
    return told


def _with_u(value: float | None, standard: float | None, unit: str) -> str:
    if value is None:
        return "–"
    if standard is None:
        return f"{value:.6g} {unit}, uncertainty not given"
    return f"{value:.6g} ± {COVERAGE * standard:.2g} {unit} (k = 2)"


def _watch(service: Any) -> None:
    from rich.console import Console
    from rich.live import Live
    from rich.table import Table

    with Live(console=Console(highlight=False), refresh_per_second=8, transient=True) as screen:
        for state in service.states():
            table = Table.grid(padding=(0, 2))
            for name, words in rows(state):
                table.add_row(name, words)
            screen.update(table)
