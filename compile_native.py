"""Compile the C sources of the packages into shared libraries beside them: `python compile_native.py`.

The wheel's build hook and `make install` run it.  Any C99 compiler serves (`estimator/core/compiler.py`); the core's
model and the emulator's list of effects are printed as C first.
"""

import importlib.util
import subprocess
import sys
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).parent
CORE = ROOT / "estimator" / "core"
EMULATOR = ROOT / "device_emulator" / "native"
FRAMES = tuple(f"firmware/src/hil_{name}.c" for name in ("spec", "frame", "crc32c"))
LIBRARIES = {
    "device_emulator/native/libdevice.so.1": ("device_emulator/native/device.c", *FRAMES),
    "hil/plugins/native/libplugin.so.1": ("hil/plugins/native/plugin.c",),
    "hil/plugins/native/libslow_flow.so.1": ("hil/plugins/shipped/slow_flow/slow_flow.c",),
    "hil/plugins/native/libclassic.so.1": ("hil/plugins/shipped/classic/classic.c",),
    "hil/running/native/libturn.so.1": ("hil/running/native/turn.c", *FRAMES),
}
"""What is built beside the core, from which sources; paths from the root of the project."""
HEADERS = {"estimator.core.generate": CORE / "model.h", "device_emulator.effects.kinds": EMULATOR / "kinds.h"}
"""What is printed as C before, by which module."""


def _loaded(script: Path) -> ModuleType:
    """A file by itself: its package is not installed yet."""
    spec = importlib.util.spec_from_file_location(script.stem, script)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def compiler() -> list[str]:
    """The command of a C compiler, empty where there is none."""
    found: list[str] = _loaded(CORE / "compiler.py").command()
    return found


def print_headers() -> None:
    """Write `HEADERS`; that of the core's model needs SymPy."""
    for module, header in HEADERS.items():
        subprocess.run([sys.executable, "-m", module, header], cwd=ROOT, check=True)


def main() -> None:
    """Compile each library; exit with one line where it cannot be done."""
    compiling, variant = _loaded(CORE / "compiler.py"), _loaded(CORE / "variant.py")
    if not compiling.command():
        sys.exit(f"compile_native: no C compiler: {compiling.CURES}")
    try:
        print_headers()
        for library, sources in LIBRARIES.items():
            compiling.compile_library([ROOT / source for source in sources], ROOT / library, compiling.WARNINGS)
        for name, options in variant.built().items():
            compiling.compile_library([CORE / "core.c"], CORE / name, (*compiling.WARNINGS, *options))
    except (compiling.CompilerError, subprocess.CalledProcessError) as error:
        sys.exit(f"compile_native: {error}")


if __name__ == "__main__":
    main()
