"""`hil.generate`: the estimator of a bench file as C for a board."""

from pathlib import Path
from typing import TYPE_CHECKING

from hil.bench import Bench
from hil.bench import load_bench as bench_at
from hil.bench.examples import bench_file
from hil.boards.identity import identity_at
from hil.errors import InputError
from hil.errors.input import path_of
from hil.library.keywords import said_of_arguments
from hil.wire.messages import Identity
from hil.wire.spec import SPEC

if TYPE_CHECKING:
    from hil.generating.c_code import Generated

_BITS = 16


@said_of_arguments
def generate(
    bench: Bench | Path | str,
    *,
    out: Path | str,
    link: str | None = None,
    latency: int | None = None,
    sense_scale: float | None = None,
    drive_scale: float | None = None,
    float32: bool = False,
    fmu: bool = False,
) -> "Generated":
    """Write observer, control law and angle of a bench as C99 into the folder `out`, with golden vectors and a test.

    link: a board whose codes and latency are taken; without one they are latency [samples], by default 1, sense_scale
    [V per code] and drive_scale [m/s² per code], by default those of converters of 16 bits.  float32: numbers of 32
    bits.  fmu: pack it as a co-simulation unit of FMI 3.0, too, for which a C compiler is needed.  Raises InputError
    for a bench that is no two-axis gyro's, or has an effect that cannot be written, and for a latency or scales beside
    a link.
    """
    told = {"--latency": latency, "--sense-scale": sense_scale, "--drive-scale": drive_scale}
    if link is not None and (given := [option for option, value in told.items() if value is not None]):
        raise InputError(f"--link: the board tells its latency and scales; take {' and '.join(given)} out")
    from hil.generating.c_code import generate as write

    declared, place = (bench, "the bench") if isinstance(bench, Bench) else _loaded(bench)
    identity = identity_at(link) if link is not None else assumed_board(declared, latency, sense_scale, drive_scale)
    return write(declared, place, identity, path_of("out", out), float32=float32, fmu=fmu)


def _loaded(name: Path | str) -> tuple[Bench, str]:
    found = bench_file("bench", name, "the path of a bench file, or the name of an example")
    return bench_at(found), found.name


def assumed_board(bench: Bench, latency: int | None, sense_scale: float | None, drive_scale: float | None) -> Identity:
    """A board with converters of 16 bits, whose sense range is four times the swing."""
    full = 1 << (_BITS - 1)
    volts = 4.0 * max(bench.swing_V)
    return Identity(
        protocol=SPEC.protocol, spec_hash=SPEC.hash, unique_id=0, firmware=0,
        tick_rate_Hz=bench.device.sample_rate_Hz, axes=bench.device.axes, sense_bits=_BITS, drive_bits=_BITS,
        sense_scale_V=volts / full if sense_scale is None else sense_scale,
        drive_scale_mps2=float(bench.device.drive_full_scale_mps2) / full if drive_scale is None else drive_scale,
        latency_ticks=1 if latency is None else latency, capabilities=0,
    )  # fmt: skip
