"""Which program makes the runs: rows of two different ones do not belong into one data set."""

import hashlib
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

_PACKAGES = ("estimator", "device_emulator", "hil")
_BESIDE = {"cli", "report", "library", "importing", "exporting", "doctor", "examples", "sweeping"}
"""Parts of `hil` that no figure of a run comes from …"""
_OF_A_RUN = {"one_run.py", "bound.py", "initial_values.py", "turn.py"}
"""… but for these files of theirs."""
_UNDER = ("numpy", "scipy", "pyarrow")


@cache
def program_digest() -> str:
    """Of every source file that a run goes through, and the versions of what computes below it."""
    digest = hashlib.sha256(" ".join(f"{name} {version(name)}" for name in _UNDER).encode())
    for package in _PACKAGES:
        spec = find_spec(package)  # the emulator is looked at as files, and never loaded
        for folder in map(Path, (spec.submodule_search_locations if spec else None) or ()):
            for source in sorted(folder.rglob("*.py")):
                if package == "hil" and source.relative_to(folder).parts[0] in _BESIDE and source.name not in _OF_A_RUN:
                    continue
                digest.update(f"{package}/{source.relative_to(folder)}\0".encode() + source.read_bytes())
    return digest.hexdigest()[:16]
