"""What generated code takes on a target, as a compiler says."""

import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

_TARGET = ("-mcpu=cortex-m7", "-mthumb", "-mfpu=fpv5-d16", "-mfloat-abi=hard")
_COMPILER = "arm-none-eabi-gcc"


@dataclass(frozen=True)
class Sizes:
    """Bytes on a Cortex-M7 at -O2: code with its constants, without the mathematical library; the struct."""

    flash_bytes: int
    struct_bytes: int


def sizes(folder: Path) -> Sizes | None:
    """Of gyro_estimator.c in a folder; None where the machine has no compiler for a Cortex-M7."""
    if shutil.which(_COMPILER) is None:
        return None
    with tempfile.TemporaryDirectory() as place:
        probe = Path(place) / "probe.c"
        probe.write_text('#include "gyro_estimator.h"\nchar probe[sizeof(gyro_estimator)];\n', encoding="ascii")
        told = {}
        for name, source in (("code", folder / "gyro_estimator.c"), ("struct", probe)):
            out = Path(place) / f"{name}.o"
            command = [_COMPILER, *_TARGET, "-std=c99", "-O2", "-ffp-contract=off", f"-I{folder}", "-c", "-o"]
            subprocess.run([*command, str(out), str(source)], check=True, capture_output=True)
            line = subprocess.run(["arm-none-eabi-size", str(out)], check=True, capture_output=True, text=True).stdout
            told[name] = [int(number) for number in line.splitlines()[1].split()[:3]]
    return Sizes(sum(told["code"][:2]), told["struct"][2])
