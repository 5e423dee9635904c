"""A run as it is asked for, checked as far as it can be without the board: for every caller alike."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, Self, cast

from pydantic import TypeAdapter

from hil.bench import Bench, load_bench, override
from hil.bench.examples import bench_file
from hil.boards.emulation import is_emulated, located
from hil.errors import InputError
from hil.errors.input import require
from hil.options import chosen
from hil.records.kind import fresh
from hil.running.beside import require_reference
from hil.running.options import OF_THE_LOOP, LocalRunOptions, RunOptions
from hil.running.safety.drives import drives, in_one_line
from hil.toml.reading import checked


@dataclass(frozen=True)
class RunRequest:
    """The bench with what was given in the place of its keys, and the link with an emulated board's scenario as a path.

    options: what else is asked, as declared.  dry_run: nothing is armed, nothing recorded.
    own_board: an emulated board is to be started for this run, and not one that serves already to be used.
    judged: figures and a verdict are made of it; without, there is the record alone.
    """

    bench: Bench
    link: str
    options: LocalRunOptions = field(default_factory=LocalRunOptions)
    dry_run: bool = False
    own_board: bool = False
    judged: bool = True

    @property
    def emulated(self) -> bool:
        """Whether the link starts its own board, where nothing real can be driven."""
        return is_emulated(self.link)

    def file(self, option: Literal["truth", "wire_log"]) -> Path | None:
        given = self.options.get(option)
        return None if given is None else Path(given)

    def as_json(self) -> dict[str, Any]:
        told: dict[str, Any] = TypeAdapter(type(self)).dump_python(self, mode="json")
        return told

    @classmethod
    def of_json(cls, told: Mapping[str, Any]) -> Self:
        return TypeAdapter(cls).validate_python(told, strict=False)


def request_of(
    bench: Bench | Path | str, options: RunOptions, *, link: str | None = None, dry_run: bool = False
) -> RunRequest:
    """Put together what is asked, files of this machine too (`LocalRunOptions`).  Raises InputError."""
    if isinstance(bench, Bench):
        path, declared, source = None, bench, bench.device.name
    else:
        path = bench_file("bench", bench)
        declared, source = load_bench(path), str(path)
    given = chosen(LocalRunOptions, options)
    loop = {key: given[key] for key in OF_THE_LOOP if given[key] is not None}
    control = {"enabled": False} if given["open_loop"] else {}
    beside = {} if given["reference"] is None else {"link": given["reference"]}
    changes = {"loop": loop, "controller": control, "reference": beside}
    declared = override(declared, changes, f"{source} with the options given")
    given = checked(LocalRunOptions, given)
    if (place := declared.link.url if link is None else link) is None:
        raise InputError(f"{source}: [link] url: missing; give it there or as --link")
    require("link", place, str, "a text such as serial:/dev/ttyACM0")
    url = located(place, beside=path)
    if declared.reference.link is not None:
        require_reference(declared, url, dry_run=dry_run)
    own_board = is_emulated(url) and not (given["truth"] is None and given["seed"] is None)
    request = RunRequest(declared, url, cast(LocalRunOptions, given), dry_run, own_board)
    if (truth := request.file("truth")) is not None:
        if not request.emulated:
            raise InputError(f"--truth: {url} is not started here; give it to its hil emulate")
        fresh(truth, replace=given["replace"], place="--truth: ")
    return request


def require_consent(request: RunRequest, *, given: bool) -> None:
    """InputError, which says what would drive it, where the board may move, and nobody said that it may."""
    if not request.emulated and not given:
        told = in_one_line(drives(request.bench, request.link)[1:])
        raise InputError(f"{request.link}: arming a board needs arm=True; it would be driven with {told}")
