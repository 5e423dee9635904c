"""Plug-ins in C, compiled for a test."""

import subprocess
from pathlib import Path

import hil
from hil.bench import Bench
from hil.plugins.native import HEADER

STRICT = ["-std=c99", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror", "-Wconversion", "-shared", "-fPIC"]


def library(source: Path) -> str:
    """The path of the library that becomes of it, beside it."""
    made = source.with_suffix(".so")
    subprocess.run(["cc", *STRICT, f"-I{HEADER.parent}", "-o", made, source, "-lm"], check=True)
    return str(made)


def generated(declared: Bench, place: Path, scenario: Path) -> str:
    """The bench's own estimator, as `hil generate` writes it for the board of a scenario."""
    hil.generate(declared, out=place, link=f"pty:{scenario}")
    return library(place / "gyro_plugin.c")
