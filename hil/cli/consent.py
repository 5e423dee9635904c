"""Consent to arming: what is on the other end of a wire may move, so a person says yes to it once per run."""

import sys
import time
from typing import TYPE_CHECKING

from hil.errors import InputError, printable

if TYPE_CHECKING:
    from estimator.trace.experiments import Turn
    from hil.bench import Bench


_BY_HAND_S = 1.0  # a period of a turn that a hand can make


def require(link: str, bench: "Bench", *, given: bool) -> None:
    """Return when arming is allowed: ``given`` by --arm or by a yes at the terminal; else `InputError`."""
    if given:
        return
    from hil.running.safety.drives import drives

    what = "\n".join(f"  {name:<20} {value}" for name, value in drives(bench, link)[1:])
    require_words(link, what, given=given, otherwise=" (--dry-run looks without arming)")


def require_words(link: str, what: str, *, given: bool, otherwise: str = "") -> None:
    """The same, with the words for what would drive the board, and for what the verb can do unarmed."""
    if given:
        return
    if not _at_terminal():
        raise InputError(f"{link}: arming a board needs --arm{otherwise}")
    print(printable(f"{link} will be armed, and driven with:"), file=sys.stderr)
    for line in what.splitlines():
        print(printable(line), file=sys.stderr)
    print("Arm it? [y/N] ", end="", file=sys.stderr, flush=True)
    if sys.stdin.readline().strip().lower() not in ("y", "yes"):
        raise InputError(f"{link}: not armed, since the answer was no")


def have_it_turned(turn: "Turn") -> None:
    """Wait until somebody turns the gyro, which no host can; where nobody is at a terminal, say so and go on."""
    how = "You can turn it by hand." if turn.period >= _BY_HAND_S else "Use a rate table, or a longer run by hand."
    print(f"The gyro has to rotate during this recording: {turn.text}. {how}", file=sys.stderr)
    print(
        "Where its rate changes faster than [observer.process_noise] rate_rad_s_per_rts says, the observer lags.",
        file=sys.stderr,
    )
    if not _at_terminal():
        print("There is no terminal to ask at, so the recording starts now.", file=sys.stderr)
        return
    print("Enter when it rotates: ", end="", file=sys.stderr, flush=True)
    sys.stdin.readline()


def _at_terminal() -> bool:
    """Whether somebody reads what is asked and can answer."""
    return sys.stdin.isatty() and sys.stderr.isatty()


def prepare(bench: "Bench") -> None:
    """Compile the effects of `bench` and of packages that the cache does not have, with a line for each on standard
    error, and a line for each of a package that is left out.

    Raises InputError for one that the bench file declares or names and that is none.
    """
    from hil.cli.show import say
    from hil.inputs.own_effects import left_out, may_have_any

    if not may_have_any(bench):
        return
    from hil.inputs.declared import device_of

    device = device_of(bench)
    for line in left_out():
        say(line)
    if not device.own:
        return
    from estimator.core.own import address, is_compiled
    from estimator.model.catalogue import model_for

    _, model = model_for(device.axes)
    for effect in device.own:
        present = effect.on(device.axes)
        if present is None or is_compiled(present, model):
            continue
        begin = time.perf_counter()
        address(present, model)
        say(f"effect {effect.name}: compiled in {time.perf_counter() - begin:.1f} s, once for this law")
