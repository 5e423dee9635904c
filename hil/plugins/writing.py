"""Templates of plug-ins, which run as they are: `hil init --plugin`."""

from importlib.resources import files
from pathlib import Path

from hil.errors import InputError
from hil.plugins.finding import Kind
from hil.plugins.native import HEADER
from hil.records.atomic import write_text

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
