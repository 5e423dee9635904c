"""Consent to arming: what is on the other end of a wire may move, so a person says yes to it once per run."""

import sys
from typing import TYPE_CHECKING

from hil.errors import InputError, printable

if TYPE_CHECKING:
    from hil.bench import Bench


def require(link: str, bench: "Bench", *, given: bool, open_loop: bool) -> None:
    """Return when arming is allowed: ``given`` by --arm or by a yes at the terminal; else `InputError`."""
    if given:
        return
    if not _at_terminal():
        raise InputError(f"{link}: arming a board needs --arm (--dry-run looks without arming)")
    if open_loop:
        force = "the drive held at zero"
    else:
        force = f"up to {bench.device.drive.full_scale:g} {_UNITS[bench.device.drive.unit]} of drive"
    print(printable(f"{link} will be armed for {bench.loop.duration_s:g} s with {force}."), file=sys.stderr)
    print("Arm it? [y/N] ", end="", file=sys.stderr, flush=True)
    if sys.stdin.readline().strip().lower() not in ("y", "yes"):
        raise InputError(f"{link}: not armed, as you wished")


def have_it_turned(bench: "Bench") -> None:
    """Wait until somebody turns the gyro, which no host can, no faster than the observer follows; where nobody is at a
    terminal, say so and go on.
    """
    wanders = bench.observer.process_noise.rate_rad_s_per_rts
    print("The gyro has to turn to and fro while this is recorded; by hand will do.", file=sys.stderr)
    print(
        f"Its rate should change by {wanders:.3g} rad/s in a second at most, as [observer.process_noise] "
        "rate_rad_s_per_rts says: where it changes faster, the observer lags behind.",
        file=sys.stderr,
    )
    if not _at_terminal():
        print("Nobody is asked, as this is no terminal: it is recorded as it lies.", file=sys.stderr)
        return
    print("Enter when it turns: ", end="", file=sys.stderr, flush=True)
    sys.stdin.readline()


def _at_terminal() -> bool:
    """Whether somebody reads what is asked and can answer."""
    return sys.stdin.isatty() and sys.stderr.isatty()


_UNITS = {"mps2": "m/s²", "N": "N", "V": "V"}
