"""In which instruction sets the core is compiled, and which of them this machine has.

`compile_native.py` loads this file by its path: it imports nothing else.
"""

import platform
from collections.abc import Iterable, Mapping
from pathlib import Path

BASELINE = "libcore.so.1"
VARIANTS: Mapping[str, tuple[str, ...]] = {"libcore-avx2.so.1": ("avx2", "bmi1", "bmi2")}
"""Beside the baseline of an x86-64, by the flags of the processor that each needs: best first.

None adds an instruction that rounds otherwise (contraction is off), so that all give one result.
"""
_OPTIONS = {"bmi1": "-mbmi"}
_X86 = ("x86_64", "amd64")


def options(flags: Iterable[str]) -> list[str]:
    """What a compiler is told of them."""
    return [_OPTIONS.get(flag, f"-m{flag}") for flag in flags]


def built() -> dict[str, list[str]]:
    """The libraries that a build on this machine makes, with the compiler's options of each."""
    others = VARIANTS if platform.machine().lower() in _X86 else {}
    return {BASELINE: []} | {name: options(flags) for name, flags in others.items()}


def best(folder: Path, processor: Iterable[str]) -> Path:
    """The library in `folder` that suits a processor with those flags best."""
    has = frozenset(processor)
    for name, flags in VARIANTS.items():
        if has.issuperset(flags) and (folder / name).exists():
            return folder / name
    return folder / BASELINE


def processor_flags() -> frozenset[str]:
    """What this machine's processor has, by Linux's names; empty where it does not say."""
    try:
        with Path("/proc/cpuinfo").open(encoding="utf-8") as lines:
            for line in lines:
                if line.startswith("flags"):
                    return frozenset(line.partition(":")[2].split())
    except OSError:
        pass
    return frozenset()
