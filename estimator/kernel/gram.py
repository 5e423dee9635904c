"""AᵀA of a tall matrix, in vector registers and on one core: beside a running loop a library's own threads would wait
for one another.
"""

from estimator.kernel.compiled import compiled
from estimator.kernel.lanes import put, take
from estimator.kernel.layout import Floats

BLOCK = 12
"""The width of the matrix is a multiple of it."""

_ROWS = 4
_PANEL = 64  # rows that stay in the cache while all of their products are taken


@compiled
def add_gram(a: Floats, width: int, out: Floats) -> None:
    """out (width · width,) += AᵀA of a (rows · width,), both flat; blocks below the diagonal are not filled."""
    rows = a.shape[0] // width
    for first in range(0, rows, _PANEL):
        last = min(first + _PANEL, rows)
        for i in range(0, width, _ROWS):
            for k in range(i - i % BLOCK, width, BLOCK):
                one = take(out, i * width + k, 12)
                two = take(out, (i + 1) * width + k, 12)
                three = take(out, (i + 2) * width + k, 12)
                four = take(out, (i + 3) * width + k, 12)
                for row in range(first, last):
                    at = row * width
                    right = take(a, at + k, 12)
                    one = one + a[at + i] * right
                    two = two + a[at + i + 1] * right
                    three = three + a[at + i + 2] * right
                    four = four + a[at + i + 3] * right
                put(out, i * width + k, one)
                put(out, (i + 1) * width + k, two)
                put(out, (i + 2) * width + k, three)
                put(out, (i + 3) * width + k, four)
