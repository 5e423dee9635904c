"""Where the controller's dither starts: a function of the run's seed alone, so that a run can be repeated."""

_DEFAULT = 0x9E3779B97F4A7C15
_WORD = (1 << 64) - 1


def dither_start(seed: int | None) -> int:
    """State (64 bits, never 0) of the xorshift generator for a seed from 0 to 2⁶³ − 1; without one a fixed default.

    The first output of SplitMix64 (Steele, Lea & Flood, OOPSLA 2014): neighbouring seeds give unrelated dithers, which
    the xorshift generator by itself does not.
    """
    if seed is None:
        return _DEFAULT
    z = (seed + 0x9E3779B97F4A7C15) & _WORD
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & _WORD
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & _WORD
    return (z ^ (z >> 31)) or _DEFAULT
