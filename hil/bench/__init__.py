"""The bench file: what the data sheet declares about a device, and how the bench is to treat it.

A bench file never holds the truth about an emulated board; that is the scenario file, which the host never
opens.  Units stand in the key names.  Two-axis devices give stiffness and damping as ``[xx, yy, xy]``,
single-axis ones as ``[xx]``.  Quantities per unit mass, as the model uses them, are properties, so that the
division by the mass is written once.
"""

from hil.bench.bench import Bench, load_any_bench, load_bench, make_way, override
from hil.bench.rate_sensor import RateSensorBench

__all__ = ["Bench", "RateSensorBench", "load_any_bench", "load_bench", "make_way", "override"]
