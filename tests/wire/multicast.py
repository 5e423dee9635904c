"""Multicast groups that no other run of these tests uses on the same machine at the same time."""

import os


def group(number: int) -> str:
    """`ADDRESS:PORT` of this process's group of that number, 0 to 4; the port after it is the group's, too."""
    high, low = divmod(os.getpid() % 62_500, 250)
    return f"239.255.{1 + high}.{1 + low}:{20_000 + 10 * (os.getpid() % 1000) + 2 * number}"
