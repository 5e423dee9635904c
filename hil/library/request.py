"""What is asked of a run, checked as far as it can be without the board: for every caller alike."""

from pathlib import Path
from typing import Any

from hil.bench import Bench, load_bench, override
from hil.boards.emulation import is_emulated, located
from hil.errors import InputError
from hil.library.places import bench_file, path_of, require
from hil.loop.drives import drives, in_one_line
from hil.loop.options import OF_THE_LOOP, RunOptions
from hil.loop.request import RunRequest
from hil.records.kind import require_unowned


def request_of(
    bench: Bench | Path | str, options: RunOptions, *, link: str | None = None, dry_run: bool = False
) -> RunRequest:
    """Put together what is asked, files of this machine too (`LocalRunOptions`).  Raises InputError."""
    if isinstance(bench, Bench):
        path, declared, source = None, bench, bench.device.name
    else:
        path = bench_file("bench", bench)
        declared, source = load_bench(path), str(path)
    given: dict[str, Any] = dict(options)
    loop = {key: given[key] for key in OF_THE_LOOP if given.get(key) is not None}
    require("note", given.get("note"), str | None, "a text")
    open_loop = bool(given.get("open_loop"))
    control = {"enabled": False} if open_loop else {}
    declared = override(declared, {"loop": loop, "controller": control}, f"{source} with the options given")
    if (place := declared.link.url if link is None else link) is None:
        raise InputError(f"{source}: [link] url: missing; give it there or as --link")
    require("link", place, str, "a text such as serial:/dev/ttyACM0")
    url = located(place, beside=path)
    file, log = (None if given.get(name) is None else path_of(name, given[name]) for name in ("truth", "wire_log"))
    if file is not None and not is_emulated(url):
        raise InputError(f"--truth: {url} is not started here; give it to its hil emulate")
    if file is not None:
        require_unowned(file, "--truth: ")
        if file.exists() and not (given.get("replace") and file.is_file()):
            raise InputError(f"--truth: {file}: exists already; give another name, or --replace")
    return RunRequest(declared, url, open_loop, dry_run, file, given.get("note"), log)


def require_consent(request: RunRequest, *, given: bool) -> None:
    """InputError, which says what would drive it, where the board may move, and nobody said that it may."""
    if not request.emulated and not given:
        told = in_one_line(drives(request.bench, request.link)[1:])
        raise InputError(f"{request.link}: arming a board needs arm=True; it would be driven with {told}")
