"""``hil serve``: the bench as a service."""

from pathlib import Path
from typing import Annotated, Unpack

import typer

from hil.cli.options import RUNS, Json, with_options
from hil.running.options import FileOptions

Folder = Annotated[Path, typer.Option("--folder", "--out", "-o", help="Folder in which the run folders are.")]
Port = Annotated[int, typer.Option("--port", "-p", min=0, max=65535, help="Port; 0 for any that is free.")]
Listen = Annotated[
    str | None,
    typer.Option("--listen", help="Address other than loopback to listen at; needs TLS or --insecure."),
]
Insecure = Annotated[bool, typer.Option("--insecure", help="Consent to --listen without TLS, where all can be read.")]
Certificate = Annotated[Path | None, typer.Option("--tls-cert", help="File with the certificate, for https.")]
Key = Annotated[Path | None, typer.Option("--tls-key", help="File with its key.")]
Names = Annotated[list[str] | None, typer.Option("--name", help="Another host name of this machine.")]
ReadOnly = Annotated[bool, typer.Option("--read-only", help="Clients may only read, and send SAFE.")]
Links = Annotated[
    list[str] | None,
    typer.Option("--link", help="A further link that requests may name, exactly as given here; may be repeated."),
]
Foxglove = Annotated[
    int | None,
    typer.Option("--foxglove", min=0, max=65535, help="Port on loopback for Foxglove's viewers; it needs no token."),
]


@with_options(FileOptions)
def serve(
    folder: Folder = RUNS,
    port: Port = 8417,
    listen: Listen = None,
    insecure: Insecure = False,
    tls_cert: Certificate = None,
    tls_key: Key = None,
    name: Names = None,
    read_only: ReadOnly = False,
    link: Links = None,
    foxglove: Foxglove = None,
    json: Json = False,
    **files: Unpack[FileOptions],
) -> None:
    """Serve the bench: a live page, the runs and traces that are there, an HTTP interface.

    Prints the address of the page, with a token in it: everybody who has the token can operate the bench. Ends with
    Ctrl-C or SIGTERM, after the board was brought to SAFE and its record closed.

    Examples:

    \b
      hil serve
      hil serve --port 0 --json
      hil serve --link can:slcan:/dev/ttyACM0
      hil serve --listen 192.168.1.20 --tls-cert bench.pem --tls-key bench.key
    """
    import sys
    from json import dumps

    from hil.service.app import lacking
    from hil.service.serve import Begun, Where
    from hil.service.serve import serve as serve_at

    if line := lacking():
        print(line, file=sys.stderr, flush=True)

    def tell(begun: Begun) -> None:
        if json:
            print(dumps(begun._asdict()), flush=True)
            return
        for role, link in begun.links.items():
            print(link if len(begun.links) == 1 else f"{role:<10} {link}", flush=True)
        if begun.foxglove is not None:
            print(f"foxglove   ws://127.0.0.1:{begun.foxglove}", flush=True)

    names, links = tuple(name or ()), tuple(link or ())
    where = Where(folder, port, listen, insecure, tls_cert, tls_key, names, read_only, foxglove, links, files)
    serve_at(where, tell)
