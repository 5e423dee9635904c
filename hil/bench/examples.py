"""Where bench, scenario and map files are found: as given, beside another file, or among the examples.

The examples travel in the wheel as package data of `hil`; in an editable install they lie in the checkout.
"""

from importlib import resources
from pathlib import Path
from typing import Any

from hil.errors import InputError
from hil.errors.input import path_of
from hil.toml.reading import suggestion
from hil.wire.regular_file import what_instead


def directory() -> Path:
    """The folder of example files; `InputError` where the installation has none."""
    package = Path(str(resources.files("hil")))
    for folder in (package / "examples", package.parent / "examples"):
        if folder.is_dir():
            return folder
    raise InputError(f"{package}: the example files are missing from this installation; reinstall gyrohil")


def names(kind: str) -> list[str]:
    """Names of the examples of a kind (`bench`, `scenario`, `map`), without the ending."""
    ending = f".{kind}.toml"
    return sorted(path.name.removesuffix(ending) for path in directory().glob(f"*{ending}"))


def find(kind: str, name: str, *, beside: Path | None = None) -> Path:
    """The file called ``name``: a path from here, a path from ``beside``'s folder, or an example's name.

    ``s-slow`` and ``s-slow.bench.toml`` both name an example.  `InputError` with the nearest name otherwise.
    """
    places = [Path(name)]
    if beside is not None:
        places.append(beside.parent / name)
    if "/" not in name:
        places += [directory() / name, directory() / f"{name}.{kind}.toml"]
    for place in places:
        if place.is_file():
            return place
    for place in places:
        if place.exists():
            raise InputError(f"{name}: is {what_instead(place)}; give a {kind} file, or the name of an example")
    bare = Path(name).name.removesuffix(f".{kind}.toml")
    raise InputError(f"{name}: no such {kind} file, and no example of that name; {suggestion(bare, names(kind))}")


def bench_file(
    argument: str, given: Any, wanted: str = "a Bench, the path of a bench file or the name of an example"
) -> Path:
    """The bench file at a path, or the example of that name.  Raises InputError where there is none."""
    return find("bench", str(path_of(argument, given, wanted)))
