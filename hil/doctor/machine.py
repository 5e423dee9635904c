"""The machine: what keeps a loop's deadlines, and the parts that make it fast. Looking changes nothing."""

import json
import os
import resource
import shutil
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, NamedTuple

from hil.running.process import line_workers

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
    remedy = f"sudo {sys.executable} -m hil.running.process.line_workers, in a terminal of its own while runs last"
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


USB_SERIAL = Path("/sys/bus/usb-serial/devices")
LATENCY_MS = 1
"""A USB adapter that holds bytes back for longer makes the loop slow."""


def examine_ports() -> Iterator[Finding]:
    """Findings about every port and interface there is."""
    from serial.tools import list_ports

    ports = sorted(port.device for port in list_ports.comports())
    if not ports:
        yield Finding("serial ports", "missing", "none; connect a board, or try pty:s-slow")
    for port in ports:
        yield from serial_port(port)
    yield from can()


def serial_port(path: str) -> Iterator[Finding]:
    """Permission of a port, and the latency timer of a USB adapter."""
    if os.access(path, os.R_OK | os.W_OK):
        yield Finding(path, "good", "may be opened")
    else:
        yield Finding(path, "bad", "no permission", f"sudo usermod -aG {owner(path)} $USER, then log in again")
    timer = USB_SERIAL / Path(path).name / "latency_timer"
    if timer.exists() and (held := int(timer.read_text())) > LATENCY_MS:
        told = f"the adapter holds bytes back for up to {held} ms"
        yield Finding(path, "missing", told, f"echo {LATENCY_MS} | sudo tee {timer}")


def owner(path: str) -> str:
    """Group that a device belongs to."""
    import grp

    try:
        return grp.getgrgid(Path(path).stat().st_gid).gr_name
    except (KeyError, OSError):
        return "dialout"


def can() -> Iterator[Finding]:
    """Whether the kernel has CAN, and the state and bit timing of each interface."""
    from hil.wire.can_link import interfaces

    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError:
        remedy = "sudo modprobe can-raw vcan, or a kernel built with CONFIG_CAN; make test-vcan needs neither"
        yield Finding("CAN", "missing", "this kernel has none (no AF_CAN)", remedy)
        return
    names = interfaces()
    if not names:
        remedy = "sudo ip link add vcan0 type vcan && sudo ip link set vcan0 mtu 72 up"
        yield Finding("CAN", "missing", "no interface", remedy)
    for name in names:
        yield can_interface(name, details(name))


def can_interface(name: str, link: dict[str, Any]) -> Finding:
    """One interface, from what `ip -json -details link show` says of it."""
    data = link.get("linkinfo", {}).get("info_data", {})
    virtual = link.get("linkinfo", {}).get("info_kind") == "vcan"
    timing = "mtu 72 up" if virtual else "up type can bitrate 1000000 dbitrate 8000000 fd on"
    if "UP" not in link.get("flags", ()):
        return Finding(name, "bad", "the interface is down", f"sudo ip link set {name} {timing}")
    if link.get("mtu", 72) < 72:
        remedy = f"sudo ip link set {name} down && sudo ip link set {name} {timing}"
        return Finding(name, "bad", "no CAN FD", remedy)
    if (state := data.get("state", "ERROR-ACTIVE")) != "ERROR-ACTIVE":
        remedy = f"check wiring, termination and bit timing, then sudo ip link set {name} type can restart"
        return Finding(name, "bad", f"the controller is in {state}", remedy)
    rates = [f"{data[key]['bitrate'] / 1e6:g} Mbit/s" for key in ("bittiming", "data_bittiming") if key in data]
    return Finding(name, "good", "up" + (f", {' and '.join(rates)}" if rates else ", virtual" if virtual else ""))


def details(name: str) -> dict[str, Any]:
    """What iproute2 knows of an interface; what the kernel's files say where it is not installed."""
    if shutil.which("ip"):
        said = subprocess.run(["ip", "-json", "-details", "link", "show", name], capture_output=True, text=True)
        if said.returncode == 0:
            link: dict[str, Any] = json.loads(said.stdout)[0]
            return link
    place = Path("/sys/class/net") / name
    up = int((place / "flags").read_text(), 16) & 1
    kind = {"linkinfo": {"info_kind": "vcan"}} if name.startswith("vcan") else {}
    return {"flags": ["UP"] if up else [], "mtu": int((place / "mtu").read_text()), **kind}


def bit_rates(name: str) -> tuple[float, float] | None:
    """(arbitration, data) bit rate of an interface, None of a virtual one."""
    data = details(name).get("linkinfo", {}).get("info_data", {})
    if "bittiming" not in data:
        return None
    slow = float(data["bittiming"]["bitrate"])
    return slow, float(data.get("data_bittiming", data["bittiming"])["bitrate"])
