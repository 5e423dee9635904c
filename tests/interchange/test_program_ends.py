"""A text that is refused leaves no reader behind that aborts the program as it ends."""

import gzip
import subprocess
import sys
from pathlib import Path

IMPORT = """
import gzip, sys, time
from pathlib import Path
from hil.errors import InputError
from hil.importing.importer import import_record

read = gzip.GzipFile.read
def slowly(self, size=-1):
    time.sleep(0.05)
    return read(self, size)
gzip.GzipFile.read = slowly
try:
    import_record(Path(sys.argv[1]), Path(sys.argv[1] + ".arrow"), map_file=Path(sys.argv[2]))
except InputError as error:
    print(error)
"""


def test_a_refusal_ends_with_its_line_alone(tmp_path: Path) -> None:
    """Its source is slow, and most of it unread when the first row is refused."""
    (tmp_path / "a.csv.gz").write_bytes(gzip.compress(b"a,b\n1,x\n" + b"1,2\n" * 600_000, 1))
    (tmp_path / "m.toml").write_text(
        'hold = "zoh"\nsampling_rate_Hz = 1.0\n[columns]\nvx = { column = "b", unit = "u" }\n', encoding="utf-8"
    )
    command = [sys.executable, "-c", IMPORT, str(tmp_path / "a.csv.gz"), str(tmp_path / "m.toml")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert "a.csv.gz:2: column b (vx): 'x' is not a number" in done.stdout
