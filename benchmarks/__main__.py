"""`python -m benchmarks [NAME …]`: measure figures and keep them in runs/bench.json.

Without names all of them run, about a quarter of an hour on two cores; `make bench` is `--speed`: those about speed, in
one table at the end, each with its peer.  Each NAME replaces its own rows in the file and leaves the others.
"""

import argparse
import importlib
import json
import os
import sys
import time
from pathlib import Path
from typing import Any

from hil.errors import InputError
from hil.records.atomic import write_text

BENCHMARKS = {
    "angle_slope": "angle per rotation in lockstep, latency 0, 1 and 3",
    "consistency": "coverage, NEES and Cramér–Rao ratio over 400 seeds of S-slow and S-classic",
    "s_classic": "the rate of S-classic at amplitude / noise = 20 beside its Cramér–Rao bound",
    "uncertainty": "errors of the angle beside its U over 60 drawn devices of three plants; kept in runs/uncertainty",
    "variants": "the observers of 7 and 11 states",
    "speed": "a step of 7, 11, 13 states, of 13 with effects, beside C, filterpy and NumPy",
    "stationary": "a tabulated gain beside the EKF, memories of 0.1 to 10 s, devices up to 5 %% off",
    "faults": "lost and corrupted frames in lockstep beside the same run on a clean line",
    "compensation": "angle and rate error in the loop before and after a trace, for every effect",
    "form_added": "the loop with the form of the missing force beside the loop with the effect it is; ten minutes",
    "custom_effect": "effects of one's own beside the catalogue's of the same form: cost of a step, angle error",
    "plug_in": "the bench's own estimator as a compiled plug-in beside the one built in: cost of a sample",
    "trace_time": "a trace of a million samples with the whole catalogue",
    "kills": "kill -9 of host, loop, recorder and board at random moments",
    "closing_scan": "the scan that closes a run: 24 s at 4 kHz, 60 s at 100 kS/s",
    "misbehaviour": "a hundred and forty ways for a board to misbehave, each with what the pages promise",
    "fuzz": "a hundred million bytes of noise and damage into every decoder",
    "attack": "ten million attacks on a keyed link, in C; a share of them in Python and over sockets; what a key costs",
    "gain_mode": "gain mode in lockstep: angle per rotation, estimates beside force mode",
    "stream": "gain mode over a pty in real time: 100, 250 kS/s, and as fast as it goes",
    "clock": "offset and skew of a board's clock, found in real time over a pty",
    "laboratory": "emulated records as laboratories have them: velocity, g, µstrain, moving bases, filters, pools",
    "repeats": "coefficients from repeats: the share of 95 % intervals that agree; a quarter of an hour",
    "catalogue": "a catalogue of 10^5 runs: read from the folders, listed, filtered, sorted, compared",
    "day": "the data sheet of a day at 1 kHz, six axes; DAY_S=N for another length",
    "series": "windows of a long record: opened, zoomed, memory; SERIES_ROWS=N for another length",
    "stream_parts": "what a streamed row costs the host, part by part",
    "campaigns": "a campaign killed ten times and gone on with; by 1, 2, 4 workers; on a Dask cluster: what it costs",
    "reference": "the turnaround of paced force mode with a commercial gyro recorded beside it, and without",
    "force_mode": "paced force mode at 4 kHz beside a bare read and write",
}
LONG = {
    "endurance": "10^9 samples in lockstep, gone on with after any kill; ENDURANCE=runs/endurance; an hour and more",
    "comparison": "the observers beside the prior art on 12 drawn records, kept in runs/comparison; ten minutes",
    "service": "pages beside the loop, SAFE from the page, kills, cycles; SERVICE_PARTS names some; an hour and more",
    "page": "the page in a real browser at 100 kS/s: pictures, processor, heap; PAGE_S=900, a quarter of an hour",
    "io_faults": "a disk that fails at every call of a run that writes; hours, IO_FAULTS_EVERY=N for one in N",
    "mutants": "a sample of small changes to what makes the bench's word: does a test fail for each; about an hour",
    "play": "48 drawn devices with, without and within the play of an elastic element: named, and how far off",
    "missing_force": "36 records with something that nobody declared: the form of the missing force; ten minutes",
    "symmetries": "78 records of boards with another clock, channel, frame or mass: is the cause listed; half an hour",
    "separations": "thirty calm devices of several accounts: whether the experiments proposed tell them apart; an hour",
    "verdicts": "340 runs on emulated devices, verdict and uncertainty beside the truth; about an hour on two cores",
}
SPEED = ("speed", "force_mode")
TARGET = Path("runs/bench.json")


def main() -> int:
    """Run what was asked for; the exit code: 1 where something could not be measured."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command line has it
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    known = BENCHMARKS | LONG
    names = "\n".join(f"{name}: {what}" for name, what in known.items())
    shortly = f"default all but {', '.join(LONG)}"
    parser.add_argument("name", nargs="*", help=f"one of {', '.join(known)}; {shortly}. {names}".replace("%", "%%"))
    parser.add_argument("--speed", action="store_true", help=f"{', '.join(SPEED)}, and their figures as one table")
    parser.add_argument("--out", type=Path, default=TARGET, help=f"default {TARGET}")
    options = parser.parse_args()
    unknown = set(options.name) - set(known)
    if unknown:
        parser.error(f"no benchmark {', '.join(sorted(unknown))}; known: {', '.join(known)}")
    failed = []
    for name in options.name or (SPEED if options.speed else BENCHMARKS):
        begin = time.monotonic()
        print(f"{name}: {known[name]}", file=sys.stderr, flush=True)
        module = importlib.import_module(f"benchmarks.{name}")
        try:
            rows = module.rows(lambda line: print(f"  {line}", file=sys.stderr, flush=True))
        except InputError as error:  # a machine that is too busy for a run on the wall clock, say
            print(f"{name}: not measured: {error}", file=sys.stderr, flush=True)
            failed.append(name)
            keep(options.out, name, [])  # what stands there is of another run
            continue
        keep(options.out, name, [{**row._asdict(), "name": f"{name}: {row.name}"} for row in rows])
        for row in rows:
            beside = "" if row.ratio is None else f"   {row.ratio:.3g} × {row.peer}"
            print(f"{name}: {row.name:<56} {row.value:>14.7g} {row.unit}{beside}", flush=True)
        print(f"{name}: {time.monotonic() - begin:.0f} s", file=sys.stderr, flush=True)
    if options.speed:
        print(table(json.loads(options.out.read_text())))
    if failed:
        print(f"not measured: {', '.join(failed)}", file=sys.stderr)
    return 1 if failed else 0


def table(rows: list[dict[str, Any]]) -> str:
    """The figures about speed that have a peer, as a table in Markdown."""
    lines = ["| what | | over | ratio | quartiles |", "|---|---|---|---|---|"]
    for row in rows:
        if row["name"].partition(":")[0] in SPEED and row["ratio"] is not None:
            spread = "" if row.get("low") is None else f"{row['low']:.2f} to {row['high']:.2f}"
            lines.append(
                f"| {row['name'].partition(': ')[2]} | {row['value']:.3g} {row['unit']} | {row['peer']} "
                f"| {row['ratio']:.3g} | {spread} |"
            )
    return "\n".join(lines)


def keep(path: Path, name: str, rows: list[dict[str, object]]) -> None:
    """Replace the rows of one benchmark in the file."""
    old = json.loads(path.read_text()) if path.exists() else []
    others = [row for row in old if not row["name"].startswith(f"{name}: ")]
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, json.dumps(others + rows, indent=1, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    sys.exit(main())
