"""From the name in a bench file to the plug-in behind it.

`mine.py:MyObserver` is a class in a file, `mine.so` a library compiled with gyro_plugin.h, `mine.npz` a table of
drives, and any other name that of an installed package's entry point, of the group `hil.observers` or
`hil.controllers`:

    [project.entry-points."hil.observers"]
    mine = "my_package:MyObserver"

The entry point leads to a class, or to the `pathlib.Path` of a library.
"""

import sys
from collections.abc import Callable
from importlib.metadata import entry_points
from importlib.resources import files
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any, Literal

from hil.bench import Bench
from hil.bench.classic import PLUGIN
from hil.errors import InputError
from hil.errors.input import loaded
from hil.plugins.native import HEADER
from hil.records.atomic import write_text
from hil.toml.reading import suggestion

Kind = Literal["observer", "controller"]
SHIPPED = {name: Path(__file__).with_name("native") / f"lib{name}.so.1" for name in (PLUGIN, "slow_flow")}
"""Plug-ins that come with the bench."""
GROUPS: dict[Kind, str] = {"observer": "hil.observers", "controller": "hil.controllers"}
TABLE = ".npz"
"""How the name of a drive table ends (`hil.plugins.of_bench`)."""
METHODS: dict[Kind, str] = {"observer": "observe", "controller": "control"}
_WORDS = 200


def is_file(name: str) -> bool:
    """Whether a plug-in's name is that of a file, rather than of an entry point."""
    return ".py:" in name or name.endswith((".so", ".py", TABLE)) or "/" in name


def called(kind: Kind, name: str) -> str:
    """A plug-in as messages call it: by the last part of its path; one that a mode brings by that key."""
    if name == PLUGIN:
        return "[controller] mode"
    return f"[{kind}] plugin {name.rpartition('/')[2]}"


def found(kind: Kind, name: str) -> Callable[..., Any] | Path:
    """The class of a plug-in, or the path of its library.  Raises InputError, one line."""
    asked = called(kind, name)
    if name.endswith((".so", TABLE)):
        return _existing(asked, name)
    file, colon, attribute = name.rpartition(":")
    if colon and file.endswith(".py"):
        return _class(asked, kind, _attribute(asked, _existing(asked, file), attribute))
    if is_file(name):
        raise InputError(f"{asked}: expected FILE.py:CLASS, FILE.so or the name of an installed plug-in")
    if name in SHIPPED:
        return _existing(asked, str(SHIPPED[name]))
    known = {entry.name: entry for entry in entry_points(group=GROUPS[kind])}
    if name not in known:
        there = suggestion(name, sorted(known)) if known else "no installed package brings one"
        raise InputError(f"{asked}: no such plug-in ({there}); give FILE.py:CLASS or FILE.so for one of your own")
    brought = loaded(known[name], asked)
    return _existing(asked, str(brought)) if isinstance(brought, Path) else _class(asked, kind, brought)


def require_no_files(bench: Bench, place: str) -> None:
    """InputError for a plug-in that is a file, in a bench that comes from elsewhere: its sender must not choose
    what this machine runs. What its owner has installed may be named.
    """
    for section, name in (("observer", bench.observer.plugin), ("controller", bench.controller.plugin)):
        if name is not None and is_file(name):
            raise InputError(
                f"{place}: [{section}] plugin: a file is run from a bench file of this machine only; install it as a "
                "package, and give its name"
            )


def _existing(asked: str, name: str) -> Path:
    path = Path(name)
    if not path.is_file():
        raise InputError(f"{asked}: no file {name}; give its path from the bench file's folder, or from here")
    return path.resolve()


def _attribute(asked: str, path: Path, attribute: str) -> Any:
    name = f"_plugin_{path.stem}"
    spec = spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look for it there
    sys.path.insert(0, str(path.parent))
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:  # noqa: BLE001 - whatever another's file does while it is imported
        raise InputError(f"{asked}: {path} cannot be loaded: {said(error)}") from None
    finally:
        sys.path.remove(str(path.parent))
    if not hasattr(module, attribute):
        own = [key for key, value in vars(module).items() if isinstance(value, type) and value.__module__ == name]
        raise InputError(f"{asked}: {path} has no {attribute}; {suggestion(attribute, own)}")
    return getattr(module, attribute)


def _class(asked: str, kind: Kind, brought: Any) -> Callable[..., Any]:
    method = METHODS[kind]
    if not callable(brought) or (isinstance(brought, type) and not callable(getattr(brought, method, None))):
        raise InputError(f"{asked}: a class with a method {method} is expected (hil.{kind.title()})")
    made: Callable[..., Any] = brought
    return made


def said(error: BaseException) -> str:
    """An exception in a few words, with the line of the plug-in that raised it."""
    words = " ".join(str(error).split())[:_WORDS]
    trace, place = error.__traceback__, ""
    while trace is not None:
        code = trace.tb_frame.f_code
        if "/hil/plugins/" not in code.co_filename and not code.co_filename.startswith("<frozen"):
            place = f", {Path(code.co_filename).name} line {trace.tb_lineno}"
        trace = trace.tb_next
    return f"{type(error).__name__}{f': {words}' if words else ''}{place}"


_CLASSES: dict[Kind, str] = {"observer": "MyObserver", "controller": "MyController"}


def write_template(kind: Kind, out: Path) -> tuple[list[Path], str]:
    """Write one into `out`, in Python or C by its ending, in C with the header beside it; the files, and the name by
    which a bench file has it.  Raises InputError for another ending.
    """
    if out.suffix not in (".py", ".c"):
        raise InputError(f"--out {out}: the name of a plug-in ends with .py or .c")
    text = files("hil.plugins").joinpath("templates", f"{kind}{out.suffix}").read_text("utf-8")
    write_text(out, text.replace(f"{kind}{out.suffix}", out.name).replace(f"{kind}.so", f"{out.stem}.so"))
    if out.suffix == ".py":
        return [out], f"{out.name}:{_CLASSES[kind]}"
    header = out.with_name(HEADER.name)
    write_text(header, HEADER.read_text("ascii"))
    return [out, header], f"{out.stem}.so"
