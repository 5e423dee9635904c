"""The command line: one verb per module; this file turns what goes wrong into one line and an exit code.

Exit codes are those of `hil.errors.ending`.  Verb modules import nothing heavy at
the top, so that ``hil --help`` answers at once.
"""

import atexit
import json
import os
import sys
import warnings
from contextlib import nullcontext
from typing import Any, NoReturn

from hil.errors import InputError, printable, refusal_of
from hil.errors.ending import ExitCode, ending_of
from hil.errors.input import Refusal
from hil.errors.interruption import take_signals
from hil.running.process.start import started_ahead

_RENAMED = {("trace", "--force"): "--missing-force", ("trace", "--no-force"): "--no-missing-force"}
_SERVE = {"emulate", "serve"}
"""Verbs that are told to end, after their one document."""
_AGAIN = "run the command again"
_BARE = {"trace", "import", "export", "show", "ls", "check", "diff", "init"}
"""Verbs that have no board, no processes and no run folder which an interruption has to bring to an end."""


def main() -> None:
    """Entry point of ``hil``; SIGTERM is taken like Ctrl-C: a board is told to go SAFE in both cases."""
    bare = bool(_BARE & set(sys.argv[1:2])) and "--live" not in sys.argv
    take_signals(leave=_leave if bare else None)
    # Before NumPy is loaded.  Work is shared out in larger pieces (`estimator.side_by_side`), and threads of its own in
    # each product of matrices only wait for those.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    warnings.formatwarning = lambda message, *_, **__: f"hil: {printable(str(message))}\n"
    with started_ahead() if _runs(sys.argv[1:]) else nullcontext():
        code = execute(sys.argv[1:])
    if code == ExitCode.INTERRUPTED:  # to take all modules and compiled code apart would take a second more
        atexit._run_exitfuncs()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    sys.exit(code)


def _runs(arguments: list[str]) -> bool:
    """Whether a run is asked for, whose loop nobody looks into: its process loads beside all that is loaded here."""
    return arguments[:1] == ["run"] and len(arguments) > 1 and not {"--live", "-h", "--help"} & set(arguments)


def _leave() -> NoReturn:
    """End at once: nothing is open that would have to be brought to an end."""
    os.write(2, b"hil: interrupted\n")
    if "--json" in sys.argv:
        os.write(1, _as_json(refusal_of("interrupted", _AGAIN), ExitCode.INTERRUPTED).encode() + b"\n")
    os._exit(ExitCode.INTERRUPTED)


def execute(arguments: list[str]) -> int:
    """Run one command line and return its exit code; a user's mistake becomes one line on standard error, and so
    does a fault of ours.
    """
    import typer

    from hil.cli.app import Stopped, app

    words = ""
    try:
        code = app(args=arguments or ["--help"], prog_name="hil", standalone_mode=False)
    except (KeyboardInterrupt, typer.Abort):
        code = ExitCode.INTERRUPTED
    except Stopped as stopped:
        code, words = ExitCode.INTERRUPTED, str(stopped)
    except Exception as error:  # noqa: BLE001 - whatever it was, it is told in one line
        misused = _misused(error, arguments)
        ending = ending_of(error if misused is None else InputError(misused), keep=True)
        _say(ending.line)
        if "--json" in arguments:
            print(_as_json(refusal_of(ending.line), ending.code))
        return ending.code
    if code == ExitCode.INTERRUPTED:  # newer typers return it, older ones raise
        _say("interrupted")
        if "--json" in arguments and not _SERVE & set(arguments[:1]):
            print(_as_json(refusal_of(words or "interrupted", _AGAIN), ExitCode.INTERRUPTED))
    return int(code or 0)


def _as_json(told: Refusal, code: ExitCode) -> str:
    return json.dumps({**told._asdict(), "exit_code": int(code)})


def _misused(error: Exception, arguments: list[str]) -> str | None:
    """What is wrong with the words of the command line; None for an error of something else."""
    import typer

    usage: Any = next(kind for kind in typer.BadParameter.__mro__ if kind.__name__ == "ClickException")
    if isinstance(error, usage):
        from hil.cli.app import app

        verb = next((one.name for one in app.registered_commands if [one.name] == arguments[:1]), None)
        option = getattr(error, "option_name", "")
        if verb is not None and (now := _RENAMED.get((verb, option))) is not None:
            return f"{option}: is called {now} now (see hil {verb} --help)"
        said = error.format_message().replace("Value error, ", "")  # pydantic's, before what typer says
        return f"{said} (see {f'hil {verb}' if verb else 'hil'} --help)"
    return None


def _say(sentence: str) -> None:
    """One line on standard error, red where that is a terminal."""
    line = "hil: " + printable(" ".join(sentence.split()))
    print(f"\033[31m{line}\033[0m" if sys.stderr.isatty() else line, file=sys.stderr)
