"""The hook of the wheel: the C libraries are compiled before files are packed, and the wheel is of this platform."""

import importlib.util
import subprocess
import sys
import sysconfig
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

_COMPILE = Path(__file__).with_name("compile_native.py")


class NativeHook(BuildHookInterface[Any]):
    """Compiles in place, so that an editable installation finds the libraries too."""

    def dependencies(self) -> list[str]:
        """What the build needs besides: a compiler from a package, where the machine has none."""
        spec = importlib.util.spec_from_file_location("compile_native", _COMPILE)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return [] if module.compiler() else ["ziglang>=0.12"]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, and name the platform; the libraries are C's own and know no version of Python."""
        subprocess.run([sys.executable, _COMPILE], check=True)
        build_data["pure_python"] = False
        platform = sysconfig.get_platform().replace("-", "_").replace(".", "_")
        build_data["tag"] = f"py3-none-{platform}"
