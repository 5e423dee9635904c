"""Every matrix that was sent in gain mode since ARM, and which of them a SENSE may name.

A host that is late hears of a matrix long after it was sent: so the list is complete, however far the host lags.
docs/wire.md, "What a host does", has the rule.
"""

from array import array

NAMES = 255  # 1 to 255, given again and again


class SentMatrices:
    """The k-th matrix since the start, from 0, is called k % 255 + 1.

    A board switches in the order in which matrices arrive, and computes with one from its effective tick on.  So what
    SENSE names must be one that was sent since ARM, not before the one in force, with an effective tick that has come.
    """

    def __init__(self, block: int) -> None:
        self._block = block
        self._effective = array("q")  # first tick that each is meant for
        self._armed = 0  # how many were sent before ARM
        self._in_force: int | None = None
        self._odd = ""
        self._odd_tick = 0  # of the last row of the SENSE that cannot be

    @property
    def next_name(self) -> int:
        """What the next matrix is called."""
        return len(self._effective) % NAMES + 1

    def sent(self, effective_tick: int) -> None:
        """The next one has left, for ticks from `effective_tick` on."""
        self._effective.append(effective_tick)

    def forget(self) -> None:
        """The board was armed again: it has forgotten what was sent before."""
        self._armed = len(self._effective)
        self._in_force = None
        self._odd = ""

    def named(self, name: int, first: int, last: int) -> str:
        """SENSE with rows from tick `first` to `last` names a matrix; in words what is wrong with one a block before,
        "" if nothing is.

        The block in which a board stops by itself names none, and STATUS may come after it: so what cannot be is held
        against the board only with the next block.  On CAN a block comes in several SENSE, each with its name.
        """
        if self._odd:
            return self._odd if last >= self._odd_tick + self._block else ""
        begin = self._armed if self._in_force is None else self._in_force
        k = begin + (name - 1 - begin) % NAMES
        if not name:
            if self._in_force is not None:
                self._odd = f"names no matrix; {self._in_force % NAMES + 1} was in force"
        elif k >= len(self._effective):
            self._odd = f"names matrix {name}; {self._told(begin)}"
        elif self._effective[k] > max(last, first + self._block - 1):
            self._odd = f"names matrix {name}, which is for tick {self._effective[k]} and later"
        else:
            self._in_force = k
        if self._odd:
            self._odd, self._odd_tick = f"SENSE of tick {last} {self._odd}", last
        return ""

    def _told(self, begin: int) -> str:
        """What could have been in force."""
        count = len(self._effective) - begin
        if not count:
            return "none was sent since ARM"
        first, last = begin % NAMES + 1, (len(self._effective) - 1) % NAMES + 1
        since = "since ARM" if self._in_force is None else f"from matrix {first}, which was in force, on"
        return f"{count} were sent {since}, the last is {last}"
