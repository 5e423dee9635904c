"""Latency and sample rate of an emulated board, given beside its scenario: on every link, told by IDENTITY, obeyed."""

from pathlib import Path

import pytest

import hil
from hil.bench import examples, load_bench, override
from hil.boards.emulation import emulator, located, shown
from hil.errors import InputError
from hil.progress import untold
from hil.running.request import RunRequest
from hil.running.run import run
from hil.wire import client
from hil.wire.endpoint import Endpoint
from hil.wire.errors import LinkError
from hil.wire.link_name import Emulated, parse_link
from hil.wire.links import open_link

SLOW = examples.find("scenario", "s-slow")


@pytest.mark.parametrize(
    ("text", "board"),
    [
        ("s-slow", Emulated("inproc", "s-slow")),
        ("s-slow?latency=4", Emulated("inproc", "s-slow", 4)),
        ("a/b.toml?latency=0&rate=8e3", Emulated("inproc", "a/b.toml", 0, 8000.0)),
    ],
)
def test_options_are_parsed_in_one_place(text: str, board: Emulated) -> None:
    assert parse_link(f"inproc:{text}") == board
    assert parse_link(board.url) == board


@pytest.mark.parametrize(
    "text", ["?latency=4", "s?latency=", "s?latency=-1", "s?latency=1.5", "s?rate=0", "s?rate=inf", "s?block=4"]
)
def test_a_bad_option_is_one_line(text: str) -> None:
    with pytest.raises(LinkError, match=r"expected SCENARIO, or SCENARIO\?latency=TICKS&rate=HZ") as caught:
        parse_link(f"inproc:{text}")
    assert "\n" not in str(caught.value)


def test_they_stay_with_the_link() -> None:
    assert located("pty:s-slow?latency=4") == f"pty:{SLOW}?latency=4"
    assert shown(f"inproc:{SLOW}?latency=4&rate=8000") == "inproc:s-slow.scenario.toml?latency=4&rate=8000"


@pytest.mark.parametrize("kind", ["pty", "inproc"])
def test_the_board_tells_them(tmp_path: Path, kind: str) -> None:
    bench = override(load_bench(examples.find("bench", "s-slow")), {"loop": {"clock": "lockstep"}}, "test")
    told = run(RunRequest(bench, located(f"{kind}:s-slow?latency=4"), dry_run=True), tmp_path, progress=untold).identity
    assert told["latency_ticks"] == 4


def test_as_options_of_the_emulator() -> None:
    with emulator(SLOW, latency_ticks=3, rate_Hz=8000.0) as board:
        endpoint = Endpoint(open_link(board.url))
        identity = client.connect(endpoint)
        endpoint.close()
    assert (identity.latency_ticks, identity.tick_rate_Hz) == (3, 8000.0)


def test_a_bench_file_that_says_otherwise_is_refused_in_one_line(tmp_path: Path) -> None:
    bench = override(load_bench(examples.find("bench", "s-slow")), {"loop": {"clock": "lockstep"}}, "test")
    with pytest.raises(InputError, match=r"the board samples at 8000 Hz, \[device\] sample_rate_Hz says 4000"):
        run(RunRequest(bench, located("inproc:s-slow?rate=8000"), dry_run=True), tmp_path, progress=untold)


def test_beyond_what_a_board_can_have_is_one_line() -> None:
    with pytest.raises(InputError, match=r"\[drive\] latency_samples: expected .*64"), emulator(SLOW, latency_ticks=65):
        raise AssertionError


@pytest.mark.long
def test_the_loop_holds_with_a_latency_of_four(tmp_path: Path) -> None:
    """The same device: the angle stays right, for the control law counts with the latency."""
    truth = tmp_path / "truth.arrow"
    done = hil.run(
        "s-slow", link="inproc:s-slow?latency=4", clock="lockstep", duration_s=12.0, out=tmp_path, truth=truth
    )
    assert done.verdict == "good"
