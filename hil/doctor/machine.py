"""The machine: what keeps a loop's deadlines, and the parts that make it fast. Looking changes nothing."""

import os
import resource
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Literal, NamedTuple

from hil.running import line_workers

State = Literal["good", "missing", "bad"]


class Finding(NamedTuple):
    """`missing` costs something that can be had; `bad` stops the link that was asked for. `remedy` is one line."""

    subject: str
    state: State
    told: str
    remedy: str = ""


AWAKE = Path("/dev/cpu_dma_latency")
_LIMITS = "/etc/security/limits.d/gyrohil.conf"


def examine() -> Iterator[Finding]:
    """Findings, in the order of what they are worth."""
    yield scheduling()
    yield carriers()
    yield memory()
    yield awake()
    yield processors()
    yield framing()


def scheduling() -> Finding:
    """Whether a process of ours may run before ordinary ones."""
    if _permitted():
        return Finding("real-time scheduling", "good", "permitted")
    remedy = f"echo '@{_group()} - rtprio 50' | sudo tee -a {_LIMITS}, then log in again"
    return Finding("real-time scheduling", "missing", "not permitted: other programs make answers late", remedy)


def carriers() -> Finding:
    """Whether the kernel's workers that carry a serial line's bytes may be put ahead of ordinary processes."""
    if line_workers.permitted():
        return Finding("kernel's line workers", "good", "a run over a serial port or a pty raises their priority")
    told = "they carry a serial line's bytes at ordinary priority: other programs make answers late"
    remedy = f"sudo {sys.executable} -m hil.running.line_workers, in a terminal of its own while runs last"
    return Finding("kernel's line workers", "missing", told, remedy)


def memory() -> Finding:
    """Whether a loop's memory can be kept from being paged out."""
    soft, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    if soft == resource.RLIM_INFINITY or os.geteuid() == 0:
        return Finding("locked memory", "good", "permitted")
    remedy = f"echo '@{_group()} - memlock unlimited' | sudo tee -a {_LIMITS}, then log in again"
    return Finding("locked memory", "missing", f"only {soft >> 20} MB may be locked: paging can stop the loop", remedy)


def awake() -> Finding:
    """Whether processors can be kept from sleeping between samples."""
    if os.access(AWAKE, os.W_OK):
        return Finding("processors kept awake", "good", str(AWAKE))
    asleep = "waking up takes up to 100 µs"
    if not AWAKE.exists():
        return Finding("processors kept awake", "missing", f"no {AWAKE} here: {asleep}")
    remedy = f"sudo setfacl -m u:$USER:rw {AWAKE} (until the next start of the machine)"
    return Finding("processors kept awake", "missing", f"{AWAKE} may not be written: {asleep}", remedy)


def processors() -> Finding:
    """Enough of them, and not busy with something else."""
    count = len(os.sched_getaffinity(0))
    load = os.getloadavg()[0]
    told = f"{count}, load {load:.1f}"
    if count < 2:
        remedy = "add a second processor: loop and recorder need one each"
        return Finding("processors", "missing", told, remedy)
    if load > 0.75 * count:
        return Finding("processors", "missing", told, "end other programs, or expect late answers")
    return Finding("processors", "good", told)


def framing() -> Finding:
    """Whether COBS is the C extension."""
    from hil.wire.framing import COBS_IN_C

    if COBS_IN_C:
        return Finding("framing", "good", "cobs has its C part (0.1 µs a frame)")
    remedy = "sudo apt install gcc python3-dev, then pip install --force-reinstall --no-binary cobs cobs"
    return Finding("framing", "missing", "cobs runs in Python (2 to 4 µs a frame)", remedy)


def _permitted() -> bool:
    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    except OSError:
        return False
    os.sched_setscheduler(0, policy, parameters)
    return True


def _group() -> str:
    import grp

    return grp.getgrgid(os.getgid()).gr_name


NEEDED = (
    ("arm-none-eabi-gcc", "compiler for boards", "gcc-arm-none-eabi libnewlib-arm-none-eabi"),
    ("qemu-system-arm", "emulated processor", "qemu-system-arm"),
)
"""Command, what it is, the Debian packages that bring it."""


def examine_target() -> Iterator[Finding]:
    """A finding for each of what generated code is measured and tested with."""
    for command, subject, packages in NEEDED:
        if found := shutil.which(command):
            yield Finding(subject, "good", found)
        else:
            told = f"no {command}: code for a Cortex-M7 is not measured or tested here"
            yield Finding(subject, "missing", told, f"sudo apt install {packages}")
