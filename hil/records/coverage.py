"""From a standard uncertainty to an expanded one (JCGM 100): the one factor that the whole bench uses."""

COVERAGE = 2.0
"""Factor k of the expanded uncertainty U = k u: about 95 % for what is nearly normal."""
