"""Puts another source in the place of one module's when it is imported. It stands alone: processes load it by its path.

GYROHIL_MUTANT is the module's name, GYROHIL_MUTANT_SOURCE the file that holds what it is to be.
"""

import importlib.abc
import importlib.machinery
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from types import CodeType, ModuleType


class _Changed(importlib.machinery.SourceFileLoader):
    """Loads a module that keeps its place and its path, and has other contents."""

    def get_code(self, fullname: str) -> CodeType:
        """Compiled each time: what lies in __pycache__ is the module as it stands."""
        return compile(Path(os.environ["GYROHIL_MUTANT_SOURCE"]).read_bytes(), self.path, "exec")


class _Finder(importlib.abc.MetaPathFinder):
    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Of the module that is being tried; None for all others."""
        if fullname != os.environ.get("GYROHIL_MUTANT"):
            return None
        spec = importlib.machinery.PathFinder.find_spec(fullname, path, target)
        if spec is not None and spec.origin is not None:
            spec.loader = _Changed(fullname, spec.origin)
        return spec


def install() -> None:
    """From now on, in this process."""
    sys.meta_path.insert(0, _Finder())
