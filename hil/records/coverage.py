"""From a standard uncertainty to an expanded one (JCGM 100), and to a 95 % interval: the factors that the whole bench
uses.
"""

COVERAGE = 2.0
"""Factor k of the expanded uncertainty U = k u: about 95 % for what is nearly normal."""

SD_95 = 1.959964
"""Half width of a 95 % interval in standard deviations of a normal variable."""
