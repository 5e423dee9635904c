"""`python -m device_emulator SCENARIO --link pty`: a board in a process of its own.

Prints one line, `ready serial:/dev/pts/N`, then serves until SIGTERM, the end of its parent, or the hang-up
of a lockstep host. Exit code 0; 2 with one line on
standard error for bad input.
"""

import argparse
import contextlib
import math
import os
import sys
from pathlib import Path

from hil.wire.errors import WireError


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    parser = argparse.ArgumentParser(prog="device_emulator", description="An emulated gyro board.")
    parser.add_argument("scenario", type=Path, metavar="SCENARIO", help="what the board really is (TOML)")
    reached = "how the host reaches it: pty, can:vcan0, udp:GROUP:PORT[?interface=ADDRESS&key=FILE]"
    parser.add_argument("--link", default="pty", help=reached)
    parser.add_argument("--truth", type=Path, metavar="FILE", help="write the true states here (Arrow)")
    parser.add_argument("--truth-every", type=_positive, default=1, metavar="N", help="one row in N (default 1)")
    parser.add_argument("--seed", type=_not_negative, metavar="N", help="instead of the scenario's")
    parser.add_argument("--latency", type=_not_negative, metavar="TICKS", help="instead of the scenario's")
    parser.add_argument("--rate", type=_rate, metavar="HZ", help="samples a second, instead of the scenario's")
    parser.add_argument(
        "--parent", type=_positive, metavar="PID", help="serve until this process has ended (default: its own)"
    )
    options = parser.parse_args(arguments)
    from device_emulator.section import ScenarioError

    try:
        _serve(options)
    except (ScenarioError, WireError) as error:
        print(f"device_emulator: {error}", file=sys.stderr)
        return 2
    return 0


def _serve(options: argparse.Namespace) -> None:
    from device_emulator.board import Board
    from device_emulator.device import Device
    from device_emulator.line import Line
    from device_emulator.scenario import load
    from device_emulator.serve import Server, stop_signal
    from device_emulator.truth_file import TruthFile, truth_metadata
    from hil.wire.links import open_board_link
    from hil.wire.messages import ClockMode

    if options.parent is None:
        options.parent = os.getppid()
    scenario = load(options.scenario, latency_ticks=options.latency, rate_Hz=options.rate)
    with contextlib.ExitStack() as stack:
        # From here on SIGTERM waits for the server, so that the truth file gets its end.
        stop = stack.enter_context(stop_signal())
        truth = None
        if options.truth is not None:
            truth = TruthFile(options.truth, truth_metadata(scenario, options.seed, options.truth_every))
            stack.callback(truth.close)
        device = Device(scenario, options.seed, None if truth is None else truth.add)
        stack.callback(device.close)
        link = open_board_link(options.link)
        stack.callback(link.close)
        board = Board(scenario, device, (ClockMode.PACED, ClockMode.LOCKSTEP), link.format)
        print(f"ready {link.url}", flush=True)
        line = Line(board, scenario, options.seed) if scenario.faults.on_the_line else None
        ended = Server(board, link, scenario.true_rate_Hz, line).run(stop, options.parent)
        if strangers := getattr(link, "strangers", 0):  # of UDP only
            print(f"device_emulator: {strangers} datagrams of others than the host were dropped", file=sys.stderr)
        if line is not None:
            told = ", ".join(f"{fate} {count}" for fate, count in sorted(line.inflicted.items()))
            print(f"device_emulator: faults inflicted: {told or 'none'}", file=sys.stderr)
        if ended:
            print(f"device_emulator: {ended}", file=sys.stderr)


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text} is not 1 or more")
    return value


def _not_negative(text: str) -> int:
    value = int(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f"{text} is not 0 or more")
    return value


def _rate(text: str) -> float:
    value = float(text)
    if not (math.isfinite(value) and value > 0.0):
        raise argparse.ArgumentTypeError(f"{text} is no rate in Hz")
    return value


if __name__ == "__main__":
    sys.exit(main())
