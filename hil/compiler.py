"""What has to be so before anything is computed: Numba may compile."""

import os

from hil.errors import InputError

_VARIABLE = "NUMBA_DISABLE_JIT"


def require_compiler() -> None:
    """InputError where Numba is told not to compile.

    Observer and emulator are written for its compiler: interpreted, they would be a thousand times too slow, and their
    tables have no named fields.
    """
    given = os.environ.get(_VARIABLE, "").strip()
    if given.strip("0"):
        raise InputError(
            f"{_VARIABLE}={given}: Numba may not compile, and nothing here runs without; take it out of the "
            f"environment (unset {_VARIABLE})"
        )
