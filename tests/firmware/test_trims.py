"""Trim outputs of the C board: told, bounded, zero in SAFE; and a run that nulls its split by them."""

from contextlib import closing
from pathlib import Path

import pytest

from hil.bench import load_bench, override
from hil.running.safety.trim_outputs import read_outputs
from hil.wire import client
from hil.wire.endpoint import Endpoint
from hil.wire.links import open_link
from hil.wire.messages import NackReason, SafeReason

from .process import pty_board
from .test_run import ran

EXAMPLES = Path(__file__).parents[2] / "examples"

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("no_report")]


def refused(host: Endpoint, name: str, code: float) -> NackReason:
    with pytest.raises(client.Refused) as refusal:
        client.write_register(host, name, code)
    return NackReason(refusal.value.reason)


def test_codes_are_bounded_and_zero_in_safe(built: Path) -> None:
    with pty_board(built, "--trims") as (_, url), closing(open_link(url)) as link:
        host = Endpoint(link)
        identity = client.connect(host)
        outputs = read_outputs(host, identity, 2.0)
        assert [(one.name, one.outputs, one.lowest, one.highest) for one in outputs] == [
            ("x", 2, 0, 4095),
            ("y", 2, 0, 4095),
        ]
        assert 4095 * outputs[0].scale_V == pytest.approx(10.0)
        assert refused(host, "TRIM_0", 5) is NackReason.BAD_STATE
        client.arm(host)
        assert client.write_register(host, "TRIM_0", 4095) == 4095
        for name, code, reason in (
            ("TRIM_0", 4096, NackReason.OUT_OF_RANGE),
            ("TRIM_1", -1, NackReason.OUT_OF_RANGE),
            ("TRIM_1", 0.5, NackReason.OUT_OF_RANGE),
            ("TRIM_2", 0, NackReason.UNKNOWN_REGISTER),
        ):
            assert refused(host, name, code) is reason
        client.make_safe(host, SafeReason.HOST_REQUEST)
        assert client.read_register(host, "TRIM_0") == 0
        assert refused(host, "TRIM_0", 5) is NackReason.BAD_STATE


def test_a_board_without_outputs_has_none(built: Path) -> None:
    with pty_board(built) as (_, url), closing(open_link(url)) as link:
        host = Endpoint(link)
        assert read_outputs(host, client.connect(host), 2.0) == []
        assert refused(host, "TRIM_0", 0) is NackReason.UNKNOWN_REGISTER


def test_a_run_nulls_the_split_of_a_c_board(built: Path, tmp_path: Path) -> None:
    target = 1.555e6
    declared = load_bench(EXAMPLES / "c-board.bench.toml")
    mass = declared.device.mass_kg
    trim = {
        "electrodes": ("x", "y"),
        "softening_N_per_m_per_V2": ((550.0 * mass, 0.0, 0.0), (0.0, 650.0 * mass, 0.0)),
        "control": True,
    }
    changes = {
        "loop": {"duration_s": 12.0, "settle_s": 8.0},
        "controller": {"target_stiffness_N_per_m": target * mass},
        "trim": trim,
    }
    with pty_board(built, "--trims") as (_, url):
        folder = ran(override(declared, changes, "test"), url, tmp_path)
    result = folder.result
    assert result is not None
    for name in ("kxx", "kyy"):
        assert result.parameters[name].value == pytest.approx(target, rel=1e-4)
    assert folder.trims is not None
    assert folder.trims.volts[-1][0] == pytest.approx(((1.602e6 - target) / 600.0) ** 0.5, rel=1e-2)
