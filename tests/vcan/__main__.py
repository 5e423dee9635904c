"""`make test-vcan`: the tests of this folder on a virtual CAN interface, wherever one can be had.

Where the kernel has CAN, that is vcan0 (made here by root, or there already).  Elsewhere Debian's user-mode Linux boots
with the machine's own files and the same Python, makes one, and runs them; that takes no root and about a minute.
Where there is neither, the tests are skipped with the reason, unless HIL_REQUIRE_VCAN=1 says that they may not be.
Further arguments go to pytest.
"""

import os
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
from contextlib import suppress
from pathlib import Path

from hil.wire.can_link import interfaces

TREE = Path(__file__).parents[2]
NAME = "vcan0"
PATIENCE_S = 900.0  # one processor, imports ten times slower; three times what it took on a quiet machine
MODULES = ("can", "can-raw", "can-dev", "vcan")  # in this order; modprobe finds them, insmod loads them
PACKAGES = "user-mode-linux kmod iproute2 busybox can-utils"

INIT = """\
#!/bin/sh
# The first process of the machine in the machine: mounts, modules, an interface, the tests.
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


WARM = """\
from pathlib import Path
import numpy as np
from device_emulator.device import Device
from device_emulator.scenario import load
device = Device(load(Path("examples/s-slow.scenario.toml")))
device.row(0, 0)
device.rows(np.zeros((2, 2), np.int32))
device.close()
"""


class NotHere(Exception):
    """No virtual CAN interface can be had; the message is the reason."""


def main(arguments: list[str]) -> int:
    """Exit code of pytest, or 0 where the tests had to be skipped."""
    with tempfile.TemporaryDirectory(prefix="vcan-") as place:
        environment = {**os.environ, "HIL_PTY_BOARD": build(Path(place)), "OPENBLAS_NUM_THREADS": "1"}
        command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", str(Path(__file__).parent), *arguments]
        try:
            return natively(command, environment) if has_can() else inside(command, environment, Path(place))
        except NotHere as reason:
            required = os.environ.get("HIL_REQUIRE_VCAN") == "1"
            print(f"tests on vcan: {'missing' if required else 'skipped'}: {reason}", file=sys.stderr)
            return int(required)


def build(place: Path) -> str:
    """The C board, for the machine at hand and the one inside alike; "" without a compiler."""
    if shutil.which("make") is None or shutil.which("cc") is None:
        return ""
    keep = {name: value for name, value in os.environ.items() if name not in ("MAKEFLAGS", "MFLAGS", "MAKELEVEL")}
    subprocess.run(
        ["make", "--silent", "-C", str(TREE / "firmware"), f"BUILD={place}/firmware", "all"], check=True, env=keep
    )
    return f"{place}/firmware/pty_board"


def warm() -> None:
    """Compile here what takes ten times as long inside."""
    subprocess.run([sys.executable, "-m", "estimator.warm"], cwd=TREE, check=True)
    subprocess.run([sys.executable, "-c", WARM], cwd=TREE, check=True)


def has_can() -> bool:
    """Whether this kernel has CAN."""
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError:
        return False
    return True


def natively(command: list[str], environment: dict[str, str]) -> int:
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


def inside(command: list[str], environment: dict[str, str], place: Path) -> int:
    """In user-mode Linux."""
    missing = [tool for tool in ("linux.uml", "insmod", "ip", "busybox", "candump") if find(tool) is None]
    if missing:
        raise NotHere(f"this kernel has no CAN, and there is no {', '.join(missing)}: sudo apt install {PACKAGES}")
    warm()
    kept = ("HOME", "LANG", "PYTHONPATH", "VIRTUAL_ENV", "HIL_PTY_BOARD", "OPENBLAS_NUM_THREADS", "NUMBA_CACHE_DIR")
    settings = {name: environment[name] for name in kept if name in environment}
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
        machine.wait(PATIENCE_S)
    except subprocess.TimeoutExpired:
        raise SystemExit(f"tests on vcan: not finished after {PATIENCE_S:.0f} s") from None
    finally:
        with suppress(ProcessLookupError):  # its helpers outlive it when it is killed
            os.killpg(machine.pid, signal.SIGKILL)
        machine.wait()
    if not code.exists():
        raise SystemExit("tests on vcan: the machine inside stopped before they had ended")
    return int(code.read_text())


def find(tool: str) -> str | None:
    """A program, also of those only root has on the path."""
    return shutil.which(tool, path=f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin")


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # by way of an exception, which ends what was started
    sys.exit(main(sys.argv[1:]))
