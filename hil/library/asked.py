"""What is asked of a run, checked as far as it can be without the board: for `hil run` and `hil.run` alike."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from hil.bench import Bench, load_bench, override
from hil.boards.emulation import is_emulated, located
from hil.errors import InputError
from hil.library.places import bench_file, path_of, require
from hil.loop.drives import drives, in_one_line
from hil.records.kind import require_unowned


class Asked(NamedTuple):
    """The bench with what was given instead of its keys, the link with an emulated board as a path, and the file for
    the truth of an emulated board.
    """

    bench: Bench
    url: str
    truth: Path | None

    @property
    def emulated(self) -> bool:
        """Whether the link starts its own board, where nothing real can be driven."""
        return is_emulated(self.url)


def asked(
    bench: Bench | Path | str,
    loop: Mapping[str, Any],
    *,
    link: str | None,
    open_loop: bool,
    truth: Path | str | None,
    replace: bool | None = None,
) -> Asked:
    """Put together what is asked; `loop` has keys of [loop], None where the bench file's stays; `replace` lets the
    truth be a file that exists, None where nobody can ask for that.

    Raises InputError that names the place.
    """
    if isinstance(bench, Bench):
        path, declared, source = None, bench, bench.device.name
    else:
        path = bench_file("bench", bench)
        declared, source = load_bench(path), str(path)
    given = {key: value for key, value in loop.items() if value is not None}
    control = {"enabled": False} if open_loop else {}
    declared = override(declared, {"loop": given, "controller": control}, f"{source} with the options given")
    if (place := declared.link.url if link is None else link) is None:
        raise InputError(f"{source}: [link] url: missing; give it there or as --link")
    require("link", place, str, "a text such as serial:/dev/ttyACM0")
    url = located(place, beside=path)
    file = None if truth is None else path_of("truth", truth)
    if file is not None and not is_emulated(url):
        raise InputError(f"--truth: {url} is not started here; give it to its hil emulate")
    if file is not None:
        require_unowned(file, "--truth: ")
        if file.exists() and not (replace and file.is_file()):
            remedy = "remove it" if replace is None else "--replace"
            raise InputError(f"--truth: {file}: exists already; give another name, or {remedy}")
    return Asked(declared, url, file)


def require_consent(request: Asked, *, given: bool) -> None:
    """InputError, which says what would drive it, where the board may move, and nobody said that it may."""
    if not request.emulated and not given:
        told = in_one_line(drives(request.bench, request.url)[1:])
        raise InputError(f"{request.url}: arming a board needs arm=True; it would be driven with {told}")
