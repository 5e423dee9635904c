"""Numbers on the page: as everywhere."""

from hil.numbers import PREFIXED as PREFIXED
from hil.numbers import count as count
from hil.numbers import counted as counted
from hil.numbers import in_thousands as in_thousands
from hil.numbers import magnitude as magnitude
from hil.numbers import percent as percent
from hil.numbers import plus_minus as plus_minus
from hil.numbers import prefix_for as prefix_for
from hil.numbers import quantity as quantity
from hil.numbers import relative as relative
from hil.numbers import sensed as sensed
from hil.numbers import share as share
from hil.numbers import signed as signed
from hil.numbers import significant as significant
from hil.numbers import together as together
from hil.numbers import unit_for as unit_for
