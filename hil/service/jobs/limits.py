"""What a process may take that reads what strangers have sent."""

import resource

MEMORY_BYTES = 6 << 30
PROCESSOR_S = 900
FILE_BYTES = 8 << 30
_FILES = 256


def limit_this_process() -> None:
    """From now on: memory, processor time, length of a file and open files are bounded, and nothing is dumped."""
    for what, most in (
        (resource.RLIMIT_AS, MEMORY_BYTES),
        (resource.RLIMIT_CPU, PROCESSOR_S),
        (resource.RLIMIT_FSIZE, FILE_BYTES),
        (resource.RLIMIT_NOFILE, _FILES),
        (resource.RLIMIT_CORE, 0),
    ):
        _, hard = resource.getrlimit(what)
        bound = most if hard == resource.RLIM_INFINITY else min(most, hard)
        # beyond the soft limit of its time a process is told why it ends, beyond the hard one it is killed
        resource.setrlimit(what, (bound, hard if what == resource.RLIMIT_CPU else bound))
