"""``hil key``: make a key file for a UDP link, or print one for firmware."""

from pathlib import Path
from typing import Annotated

import typer

from hil.cli.options import Json

KeyFile = Annotated[Path, typer.Argument(metavar="FILE", help="Key file; made if it is not there.")]
AsC = Annotated[bool, typer.Option("--c", help="Print the key as C, for a board's firmware. Keep that as secret.")]


def key(file: KeyFile, c: AsC = False, json: Json = False) -> None:
    """Make a key for a UDP link that leaves this machine.

    The file is readable by you only (mode 0600), and one that exists is never overwritten. Host and board need the same
    key; give each board its own.

    Examples:

    \b
      hil key gyro-7.key
      hil key gyro-7.key --c > board/secret_key.h
      hil run my.bench.toml --link "udp:239.0.0.1:4242?interface=192.168.1.20&key=gyro-7.key" --arm
    """
    from hil.cli.show import print_json, say
    from hil.wire.key_file import as_c, make_key, read_key

    made = not (c and file.exists())
    secret = make_key(file) if made else read_key(file)
    if c and not json:
        print(as_c(secret), end="")
    elif json:
        print_json({"file": str(file), "made": made, **({"c": as_c(secret)} if c else {})})
    else:
        say(f"{file}: a new key, readable by you only")
