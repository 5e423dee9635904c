"""Where a board can be reached from here: serial ports and CAN interfaces, and what stands in the way."""

import json
import os
import shutil
import socket
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from hil.doctor.machine import Finding

USB_SERIAL = Path("/sys/bus/usb-serial/devices")
LATENCY_MS = 1
"""A USB adapter that holds bytes back for longer makes the loop slow."""


def examine() -> Iterator[Finding]:
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
