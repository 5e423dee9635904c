"""An identification as it is asked for, checked as far as it can be without the board: for every caller alike."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from estimator.identify.schedule import LENGTHS
from hil.bench import Bench, load_bench
from hil.bench.examples import find
from hil.boards.emulation import is_emulated, located
from hil.errors import InputError
from hil.errors.input import names_of, require
from hil.identifying.advice import Wishes
from hil.identifying.options import LocalIdentifyOptions
from hil.identifying.recording import ticks
from hil.numbers import counted
from hil.options import chosen
from hil.records.kind import fresh, named_by


@dataclass(frozen=True)
class IdentifyRequest:
    """link: None where records are given; out: bench file to write, None for none; else as `LocalIdentifyOptions`."""

    link: str | None
    out: Path | None
    records: tuple[Path, ...]
    declared: Bench | None
    sense_limit_V: float | None
    drive_limit_mps2: float | None
    mass_kg: float | None
    temperature_K: float
    amplitude_m: float | None
    wishes: Wishes
    name: str

    @property
    def kept_link(self) -> str | None:
        """The link that the bench file keeps: one that leads to a real board."""
        return None if self.link is None or is_emulated(self.link) else self.link

    @property
    def emulated(self) -> bool:
        """Whether nothing real can be driven."""
        return self.link is None or is_emulated(self.link)


def request_of(link: str | None, out: Path | None, options: LocalIdentifyOptions) -> IdentifyRequest:
    """Put together what is asked.  Raises InputError."""
    given: dict[str, Any] = chosen(LocalIdentifyOptions, options)
    records = tuple(map(Path, names_of("record", given.pop("record"))))
    if (link is None) == (not records):
        raise InputError("identify: give the link of a board, or --record RUN, one of the two")
    if link is not None:
        require("link", link, str, "a text such as serial:/dev/ttyACM0")
    if out is not None:
        fresh(out, replace=bool(given["replace"]))
    like = given.pop("like")
    for name in ("sense_limit_V", "drive_limit_mps2", "mass_kg", "temperature_K", "amplitude_m", *Wishes._fields):
        if given[name] is not None and not given[name] > 0.0:
            raise InputError(f"{name}: {given[name]:g}; give a number above 0")
    del given["replace"]
    given["wishes"] = Wishes(*(given.pop(name) for name in Wishes._fields))
    given["name"] = given["name"] or ("identify" if out is None else named_by(out))
    return IdentifyRequest(
        None if link is None else located(link), out, records,
        None if like is None else load_bench(find("bench", like)), **given,
    )  # fmt: skip


def require_consent(request: IdentifyRequest, *, given: bool) -> None:
    """InputError, which says what would drive it, where the board may move, and nobody said that it may."""
    if not request.emulated and not given:
        raise InputError(f"{request.link}: arming a board needs arm=True; it would be driven with {told(request)}")


def told(request: IdentifyRequest) -> str:
    """What the experiment brings the board, in a line."""
    drive = "0.9 of its range" if request.drive_limit_mps2 is None else f"{request.drive_limit_mps2:g} m/s²"
    sense = "0.6 of its range" if request.sense_limit_V is None else f"{request.sense_limit_V:g} V"
    return (
        f"sweeps, bursts and a random pattern up to {drive}, for at most {counted(ticks(LENGTHS), 'tick')}; "
        f"nothing is driven on beyond a sense voltage of {sense}"
    )
