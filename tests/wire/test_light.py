"""Importing the wire drags in neither the bench nor heavy libraries."""

import subprocess
import sys

import pytest

PROBE = """
import sys
import hil.wire.client, hil.wire.links, hil.wire.pty_link, hil.wire.serial_link, hil.wire.inproc
print(*sorted(name for name in sys.modules))
"""


@pytest.mark.moderate
def test_what_is_loaded():
    run = subprocess.run([sys.executable, "-c", PROBE], capture_output=True, text=True, check=True)
    loaded = set(run.stdout.split())
    tops = {name.partition(".")[0] for name in loaded}
    assert tops.isdisjoint(
        {"numba", "scipy", "sympy", "pyarrow", "matplotlib", "pydantic", "estimator", "device_emulator"}
    )
    assert {name for name in loaded if name.startswith("hil.") and not name.startswith("hil.wire")} == set()


@pytest.mark.moderate
def test_links_load_serial_only_when_asked():
    code = "import sys, hil.wire.links; sys.exit('serial' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
