"""The version of a build, from git's tags: hatchling evaluates `VERSION` (pyproject.toml).

v1.2.3 is 1.2.3; 4 commits later it is 1.2.4.dev4+gHASH, as setuptools-scm counts. A source distribution has the version
that it was packed with. Where there is neither, as in a copy without history, it is `UNTAGGED`.
"""

import re
import subprocess
from pathlib import Path

UNTAGGED = "0.1.0"
TREE = Path(__file__).resolve().parent

_DESCRIBED = re.compile(r"v(\d+\.\d+\.)(\d+)-(\d+)-(g[0-9a-f]+)")
_PACKED = re.compile(r"^Version: (\S+)$", re.MULTILINE)


def of_description(described: str) -> str:
    """The version that `git describe --tags --long` tells; UNTAGGED where it tells none."""
    found = _DESCRIBED.fullmatch(described)
    if not found:
        return UNTAGGED
    begin, last, since, commit = found.groups()
    return f"{begin}{last}" if since == "0" else f"{begin}{int(last) + 1}.dev{since}+{commit}"


def version(tree: Path = TREE) -> str:
    """Of what is built in a folder."""
    packed = tree / "PKG-INFO"
    if packed.is_file():
        found = _PACKED.search(packed.read_text(encoding="utf-8"))
        return found[1] if found else UNTAGGED
    if not (tree / ".git").exists():  # of no other repository around it
        return UNTAGGED
    command = ["git", "-C", tree, "describe", "--tags", "--long", "--match", "v[0-9]*.[0-9]*.[0-9]*"]
    try:
        return of_description(subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip())
    except OSError:  # no git on this machine
        return UNTAGGED


VERSION = version()
