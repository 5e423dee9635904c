"""Which records a set has: by a secret of its keeper, so long that nobody finds it by trying.

A draw of `evaluation.undeclared` will not do: its records have seeds of 32 bits, which can all be tried until a device
comes out whose bench file is the one that is published; and which effect is hidden in the first record stands in the
source.
"""

import hashlib
import secrets
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from evaluation.undeclared.population import Order, kinds

SHARES = {"single": 6, "clean": 2, "outside": 2, "double": 2}
"""Records of each category, of twelve."""
_LEAST = 32  # characters


@dataclass(frozen=True)
class Sealed(Order):
    """A record whose seed comes from the secret."""

    secret: bytes

    @property
    def seed(self) -> int:
        """63 bits of the secret and the name."""
        return _number(self.secret, self.name)


def _number(secret: bytes, what: str) -> int:
    return int.from_bytes(hashlib.sha256(secret + b"\0" + what.encode()).digest()[:8], "big") >> 1


def orders(count: int, secret: bytes) -> list[Sealed]:
    """`count` records: categories by their shares, effects drawn of those of the category, all in an order drawn."""
    rng = np.random.default_rng(_number(secret, "orders"))
    wanted = [category for category, share in SHARES.items() for _ in range(share)]
    categories = [wanted[i % len(wanted)] for i in rng.permutation(max(count, len(wanted)))[:count]]
    found = []
    for number, category in enumerate(categories):
        known = kinds(category)
        found.append(Sealed(category, known[int(rng.integers(len(known)))], number, 0, secret))
    return found


def make_secret(path: Path) -> None:
    """Write a new one, 256 bits, for the keeper's eyes.  Ends with one line where the file is there already."""
    if path.exists():
        raise SystemExit(f"challenge: {path} is there already; a secret that sets were made by is not made anew")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch(mode=0o600)
    path.write_text(secrets.token_hex(32) + "\n")


def read_secret(path: Path) -> bytes:
    """The secret in a file.  Ends with one line where it is none."""
    try:
        text = path.read_text().strip()
    except OSError as error:
        why = str(error.strerror).lower()
        raise SystemExit(f"challenge: {path}: {why}; make one: python -m benchmarks.challenge secret {path}") from None
    if len(text) < _LEAST:
        raise SystemExit(f"challenge: {path}: {len(text)} characters can be tried out; give {_LEAST} or more")
    return text.encode()
