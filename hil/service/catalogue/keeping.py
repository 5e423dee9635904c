"""The catalogue kept up to date while the service lasts, by a thread that looks at the folders."""

import logging
import sqlite3
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from hil.service.catalogue.catalogue import Catalogue, Looked

_EVERY_S = 2.0
_WHOLE_S = 60.0  # between two looks at every folder …
_REST = 10  # times as long as a quick look takes, nobody looks
_SHARE = 50  # … and at least so many times as long as such a look takes
_END_S = 30.0
_LOG = logging.getLogger("hil.service")


@contextmanager
def kept(catalogue: Catalogue, told: Callable[[Looked], None]) -> Iterator[None]:
    """Keep it up to date for the length of the block; `told` what each look came to that found something."""
    ending = threading.Event()
    thread = threading.Thread(target=_keep, args=(catalogue, told, ending), name="catalogue", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ending.set()
        thread.join(_END_S)


def _keep(catalogue: Catalogue, told: Callable[[Looked], None], ending: threading.Event) -> None:
    next_whole_s, wait_s = 0.0, 0.0
    while not ending.wait(wait_s):
        began_s = time.monotonic()
        whole = began_s >= next_whole_s
        try:
            found = catalogue.look(whole=whole, stop=ending.is_set)
        except (OSError, sqlite3.Error) as error:  # a disk that is full, a folder that went away: they may come back
            _LOG.warning("the runs could not be looked at: %s", error)
            found = Looked(0, 0, ())
        took_s = time.monotonic() - began_s
        if whole:
            next_whole_s = time.monotonic() + max(_WHOLE_S, _SHARE * took_s)
        wait_s = _EVERY_S if whole else max(_EVERY_S, _REST * took_s)
        if found.changed or found.gone:
            told(found)
