"""Noise, damaged frames and senseless messages into the decoders."""

import shutil
import subprocess
from pathlib import Path

import pytest
from cobs import cobs

from hil.wire.framing import MAX_BODY, MIN_BODY, Decoder
from tests.firmware import fuzzing as fuzz

from .conftest import FIRMWARE, make

SEEDS = [1, 2]


@pytest.fixture(scope="module")
def fuzzer(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make(tmp_path_factory.mktemp("fuzz"), "fuzz") / "fuzz"


@pytest.mark.moderate
@pytest.mark.parametrize("seed", SEEDS)
def test_python_decoder_of_serial_lines(seed: int) -> None:
    tally = fuzz.feed_serial(1_000_000, seed)
    assert tally.corrupt == 0
    assert tally.checked > 1.2 * tally.taken > 10_000


@pytest.mark.moderate
@pytest.mark.parametrize("seed", SEEDS)
def test_python_decoder_of_can_frames(seed: int) -> None:
    tally = fuzz.feed_can(1_000_000, seed)
    assert tally.messages > 5_000


@pytest.mark.beyond(1)
@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_c_decoders_and_board(fuzzer: Path, seed: int) -> None:
    tally = fuzz.feed_c(fuzzer, 3_000_000, seed)
    assert tally.bytes >= 3_000_000
    assert tally.corrupt == 0
    assert tally.checked > 1.2 * tally.taken > 5_000
    assert tally.messages > 20_000  # said by the boards


class Gullible(Decoder):
    """Takes whatever is COBS for a frame."""

    def _open(self, run: bytes) -> bytes | None:
        try:
            body: bytes = cobs.decode(run)
        except cobs.DecodeError:
            return None
        if not MIN_BODY <= len(body) <= MAX_BODY:
            return None
        self.frames += 1
        return body


@pytest.mark.moderate
def test_a_python_decoder_without_its_checksum_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fuzz, "Decoder", Gullible)
    assert fuzz.feed_serial(300_000, 1).corrupt > 0


@pytest.mark.parametrize(
    ("file", "line", "broken"),
    [
        ("hil_frame.c", "if (r->crc != HIL_CRC32C_RESIDUE)", "if (r->crc == 0u)"),
        ("hil_frame.c", "if (r->body_size < r->room)", "if (r->body_size <= r->room)"),
        ("hil_gain.c", "if (exact > limit || exact < -limit) {", "if (exact > limit) {"),
    ],
)
@pytest.mark.long
def test_a_broken_library_is_found_out(tmp_path: Path, file: str, line: str, broken: str) -> None:
    """No checksum; a byte beyond the memory; a limit on one side only."""
    shutil.copytree(FIRMWARE / "src", tmp_path / "src")
    source = tmp_path / "src" / file
    assert line in source.read_text()
    source.write_text(source.read_text().replace(line, broken))
    sources = [*map(str, (tmp_path / "src").glob("*.c")), str(FIRMWARE / "fuzz" / "fuzz.c")]
    options = ["-g", "-fsanitize=address,undefined,float-cast-overflow", "-fno-sanitize-recover=all"]
    command = ["cc", "-O1", *options, f"-I{tmp_path / 'src'}", "-o", str(tmp_path / "fuzz"), *sources]
    subprocess.run(command, check=True)
    done = subprocess.run([tmp_path / "fuzz", "3000000"], capture_output=True, check=False)
    assert done.returncode != 0
