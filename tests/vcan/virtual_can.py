"""A virtual CAN interface to run a command with, wherever one can be had.

Where the kernel has CAN, that is vcan0 (made here by root, or there already).  Elsewhere Debian's user-mode Linux boots
with the machine's own files and the same Python, makes one, and runs the command; that takes no root.  Inside there is
one processor, ten times slower.
"""

import os
import shlex
import shutil
import signal
import socket
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

from hil.wire.can_link import interfaces

TREE = Path(__file__).parents[2]
NAME = "vcan0"
MODULES = ("can", "can-raw", "can-dev", "vcan")  # in this order; modprobe finds them, insmod loads them
PACKAGES = "user-mode-linux kmod iproute2 busybox can-utils"
KEPT = (
    "HOME",
    "LANG",
    "PYTHONPATH",
    "PYTHONPYCACHEPREFIX",
    "VIRTUAL_ENV",
    "HIL_PTY_BOARD",
    "OPENBLAS_NUM_THREADS",
)
"""Of the environment, what the machine inside is given, beside a path."""

INIT = """\
#!/bin/sh
# The first process of the machine in the machine: mounts, modules, an interface, the command.
mount -t proc proc /proc
mount -t sysfs sys /sys
mkdir -p /dev/shm /dev/pts
mount -t tmpfs tmpfs /dev/shm
mount -t devpts devpts /dev/pts
for module in {modules}; do
  insmod "$(find /usr/lib/uml/modules/$(uname -r) -name "$module.ko*" | head -n 1)"
done
ip link set lo up
ip link add {name} type vcan
ip link set {name} mtu 72 up
cd {tree}
{command} </dev/null
echo $? > {code}
sync
busybox poweroff -f
"""


class NotHere(Exception):
    """No virtual CAN interface can be had; the message is the reason."""


def with_vcan(command: list[str], environment: dict[str, str], place: Path, patience_s: float) -> int:
    """Exit code of a command that finds vcan0, run in the folder of the project.

    `place` is an empty folder for what it takes; inside user-mode Linux the command may last `patience_s`, then the
    machine is switched off and SystemExit raised.  Raises NotHere.
    """
    return _natively(command, environment) if has_can() else _inside(command, environment, place, patience_s)


def has_can() -> bool:
    """Whether this kernel has CAN."""
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError:
        return False
    return True


def _natively(command: list[str], environment: dict[str, str]) -> int:
    """On this machine's own vcan0."""
    if NAME in interfaces():
        return subprocess.run(command, cwd=TREE, env=environment, check=False).returncode
    add = f"ip link add {NAME} type vcan && ip link set {NAME} mtu 72 up"
    if os.geteuid() != 0:
        raise NotHere(f"this kernel has CAN, but there is no {NAME}: sudo sh -c '{add}'")
    subprocess.run(["modprobe", "vcan"], check=False)
    if subprocess.run(["sh", "-c", add], check=False).returncode != 0:
        raise NotHere(f"{NAME} cannot be made: {add}")
    try:
        return subprocess.run(command, cwd=TREE, env=environment, check=False).returncode
    finally:
        subprocess.run(["ip", "link", "delete", NAME], check=False)


def _inside(command: list[str], environment: dict[str, str], place: Path, patience_s: float) -> int:
    """In user-mode Linux."""
    missing = [tool for tool in ("linux.uml", "insmod", "ip", "busybox", "candump") if find(tool) is None]
    if missing:
        raise NotHere(f"this kernel has no CAN, and there is no {', '.join(missing)}: sudo apt install {PACKAGES}")
    settings = {name: environment[name] for name in KEPT if name in environment}
    settings["PATH"] = f"{Path(sys.executable).parent}:/usr/sbin:/usr/bin:/sbin:/bin"
    init, code = place / "init", place / "code"
    init.write_text(
        INIT.format(
            modules=" ".join(MODULES),
            name=NAME,
            tree=shlex.quote(str(TREE)),
            command=shlex.join(["env", *(f"{name}={value}" for name, value in settings.items()), *command]),
            code=code,
        )
    )
    init.chmod(0o755)
    linux = find("linux.uml")
    assert linux is not None
    options = [
        "mem=1G",
        "rootfstype=hostfs",
        "rootflags=/",
        "rw",
        f"init={init}",
        "con=null",
        "con0=fd:0,fd:1",
        "quiet",
    ]
    machine = subprocess.Popen([linux, *options], stdin=subprocess.DEVNULL, start_new_session=True)
    try:
        machine.wait(patience_s)
    except subprocess.TimeoutExpired:
        raise SystemExit(f"the machine with vcan0: not finished after {patience_s:.0f} s") from None
    finally:
        with suppress(ProcessLookupError):  # its helpers outlive it when it is killed
            os.killpg(machine.pid, signal.SIGKILL)
        machine.wait()
    if not code.exists():
        raise SystemExit("the machine with vcan0: it stopped before the command had ended")
    return int(code.read_text())


def find(tool: str) -> str | None:
    """A program, also of those only root has on the path."""
    return shutil.which(tool, path=f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin")
