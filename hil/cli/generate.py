"""``hil generate``: the estimator of a bench file as C for a board."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from hil.cli.options import BenchArgument, Json, Link, Replace

Target = Annotated[Path, typer.Option("--out", "-o", help="Folder to write into.")]
Float32 = Annotated[bool, typer.Option("--float32", help="Numbers of 32 bits instead of 64.")]
Fmu = Annotated[bool, typer.Option("--fmu", help="Pack it as a co-simulation unit of FMI 3.0, too.")]
Latency = Annotated[
    int | None,
    typer.Option("--latency", min=0, max=15, help="Number of samples from a sample to its drive.  [default: 1]"),
]
SenseScale = Annotated[
    float | None, typer.Option("--sense-scale", help="Volts of a sense code.  [default: 4 amplitudes in 16 bits]")
]
DriveScale = Annotated[
    float | None, typer.Option("--drive-scale", help="m/s² of a drive code.  [default: the full scale in 16 bits]")
]


def generate(
    bench: BenchArgument,
    out: Target,
    link: Link = None,
    latency: Latency = None,
    sense_scale: SenseScale = None,
    drive_scale: DriveScale = None,
    float32: Float32 = False,
    fmu: Fmu = False,
    replace: Replace = False,
    json: Json = False,
) -> None:
    """Write observer, control law and angle of a bench file as C99 for a board, with golden vectors and a test.

    The code is the source that the bench itself runs, reduced to the effects that the file declares: no malloc, no
    global variables, one struct. With --link the scales of the codes and the latency are read from the board;
    otherwise give them as options.

    Examples:

    \b
      hil generate s-slow --out estimator
      hil generate s-slow --out estimator --float32 --latency 2
      hil generate s-slow --out estimator --fmu
      hil generate my.bench.toml --out estimator --link serial:/dev/ttyACM0
    """
    from hil.cli.show import print_json, say
    from hil.errors import InputError
    from hil.library.generating import generate as write

    if out.exists() and not replace:
        raise InputError(f"{out}: exists already; give another name, or --replace")
    done = write(
        bench,
        out=out,
        link=link,
        latency=latency,
        sense_scale=sense_scale,
        drive_scale=drive_scale,
        float32=float32,
        fmu=fmu,
    )
    taken = done.sizes
    if json:
        told = None if taken is None else asdict(taken)
        print_json({"folder": str(done.folder), "files": list(done.files), "cortex_m7": told})
        return
    say(f"{done.folder}: {', '.join(done.files)}")
    if taken is None:
        say("  sizes unknown: no arm-none-eabi-gcc; sudo apt install gcc-arm-none-eabi libnewlib-arm-none-eabi")
    else:
        memory = f"{taken.struct_bytes} of memory, {taken.stack_bytes or 'unknown'} of stack"
        say(f"  on a Cortex-M7 at -O2: {taken.flash_bytes} bytes of code and constants, {memory}")
    say(f"  next: make -C {done.folder} test")
