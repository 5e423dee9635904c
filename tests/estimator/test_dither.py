"""Where the dither starts."""

from estimator.dither import dither_start


def test_it_is_the_first_output_of_splitmix64() -> None:
    """The published one for the seed 1234567, as in Java's SplittableRandom."""
    assert dither_start(1234567) == 6457827717110365317


def test_it_never_starts_at_zero_from_which_xorshift_would_not_move() -> None:
    zero = -0x9E3779B97F4A7C15 % (1 << 64)  # the one seed whose mixed value is 0; it lies beyond 2⁶³ − 1
    assert dither_start(zero) != 0
    assert 0 < dither_start(2**63 - 1) < 1 << 64


def test_every_seed_has_its_own() -> None:
    assert len({dither_start(seed) for seed in (None, *range(1000))}) == 1001
