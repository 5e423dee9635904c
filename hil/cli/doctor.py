"""``hil doctor``: what this machine and a link can hold, what is missing, and how to get it."""

from typing import TYPE_CHECKING, Annotated

import typer

from hil.cli.options import Json

DoctorLink = Annotated[
    str | None, typer.Option("--link", "-l", help="Check and measure this link too; no real board is armed.")
]

if TYPE_CHECKING:
    from hil.doctor.machine import Finding

_STYLES = {"good": "green", "missing": "yellow", "bad": "red"}


def doctor(link: DoctorLink = None, json: Json = False) -> None:
    """Check what a loop needs on this machine; one line per item says what is missing and how to get it.

    With --link it asks the board for its IDENTITY and measures round trip and jitter on that link. A table shows what
    this machine can sustain there: the highest rate in force mode at a board latency of 1 and 4 ticks, the highest rate
    in gain mode, and the smallest block at the board's own rate. Exit code 1: the link cannot be used.

    Examples:

    \b
      hil doctor
      hil doctor --link serial:/dev/ttyACM0
      hil doctor --link can:can0 --json
      hil doctor --link pty:s-slow
    """
    from hil.boards.emulation import located
    from hil.doctor import link as link_
    from hil.doctor import machine
    from hil.errors.ending import ExitCode, is_fault

    findings = [*machine.examine(), *machine.examine_target(), *machine.examine_ports()]
    measured = None
    if link is not None:
        about_link, measured = link_.examine(located(link))
        findings += about_link
    # A port nobody asked for may be closed to us; that is worth a line, not a failure.
    wrong = any(finding.state == "bad" for finding in (about_link if link is not None else ()))
    if json:
        from hil.cli.show import print_json

        print_json({"findings": [finding._asdict() for finding in findings], "link": link, "measured": measured})
    else:
        _print(findings)
        if measured is not None:
            print_holds(measured["holds"])
    fault = any(is_fault(finding.told) for finding in findings)
    raise typer.Exit(ExitCode.FAULT if fault else ExitCode.AGAINST if wrong else ExitCode.GOOD)


def print_holds(rows: "list[tuple[str, str, str]]") -> None:
    """The table of what this machine holds on a link; nothing where that was not measured."""
    if not rows:
        return
    from hil.cli.output import Output

    output = Output()
    output.say()
    output.table(
        ("this machine keeps up", "with", ""), [(f"{mode} mode", setting, most) for mode, setting, most in rows]
    )


def _print(findings: "list[Finding]") -> None:
    from hil.cli.output import Output

    output = Output()
    for finding in findings:
        output.say(f"{finding.state:<8}", style=_STYLES[finding.state], end="")
        output.say(f"{finding.subject:<24}{finding.told}")
        if finding.remedy:
            output.say(f"{'':<32}{finding.remedy}")
