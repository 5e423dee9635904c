"""What the host knows by itself of why a board may have missed its drives: its own clock, its own counts.

Only a stop that this accounts for lets a board be armed again.
"""

from hil.wire.endpoint import Endpoint
from hil.wire.messages import Status


class Account:
    """Kept for a board that goes SAFE after `watchdog_ticks` without a drive; answers come every `block` ticks.

    Attributes:
        suspicious_ns: a time between two answers from which on `silent` is to be told.
    """

    def __init__(self, endpoint: Endpoint, watchdog_ticks: int, block: int, rate_Hz: float, latency: int) -> None:
        self._endpoint = endpoint
        self._watchdog_s = watchdog_ticks / rate_Hz
        # The board counts from when it has the last drive to when it has the next: neither end sees the same time.
        self.suspicious_ns = round(1e9 * max(watchdog_ticks - 2 * block, 0.5 * watchdog_ticks) / rate_Hz)
        self._held_ticks = max(watchdog_ticks - 2 - latency, 1)
        self.begin(None)

    def begin(self, status: Status | None) -> None:
        """The board has been armed and said `status`: what comes from now on counts."""
        rx = self._endpoint.rx
        self._base = rx.lost, rx.decoder.bad, self._missed(status)
        self._refused = rx.undecodable
        self._silent_ns = 0
        self._held = self._held_run = 0
        self._held_next: int | None = None  # the tick with which the run goes on

    @property
    def held_so_far(self) -> tuple[int, int, int | None]:
        """The longest run of rows without a drive, the one under way, and the tick with which it goes on."""
        return self._held, self._held_run, self._held_next

    @held_so_far.setter
    def held_so_far(self, value: tuple[int, int, int | None]) -> None:
        self._held, self._held_run, self._held_next = value

    def silent(self, elapsed_ns: int) -> None:
        """So long passed between two answers of this host."""
        self._silent_ns = max(self._silent_ns, elapsed_ns)

    def held(self, tick: int) -> None:
        """The row of `tick` says that no drive had come for its interval."""
        self._held_run = self._held_run + 1 if tick == self._held_next else 1
        self._held_next = tick + 1
        self._held = max(self._held, self._held_run)

    @property
    def refused(self) -> int:
        """Intact frames that no host could take; their sender keeps this host silent."""
        return self._endpoint.rx.undecodable - self._refused

    def of_silence(self, status: Status | None) -> str:
        """What accounts for samples that stopped coming: frames that were lost or damaged on the line."""
        rx = self._endpoint.rx
        lost, damaged, missed = self._base
        missed = max(self._missed(status) - missed, 0) if status is not None else 0
        lost, damaged = rx.lost - lost, rx.decoder.bad - damaged
        if lost + damaged + missed == 0:
            return ""
        return f"{lost + damaged} frames to the host and {missed} to the board were lost or damaged"

    def of_watchdog(self, status: Status | None) -> str:
        """What accounts for a watchdog that tripped."""
        if not self.refused and self._silent_ns >= self.suspicious_ns:
            return f"this host sent nothing for {1e-9 * self._silent_ns:.3g} s"
        if self._held >= self._held_ticks:
            return f"answers were late on {self._held} ticks running"
        return self.of_silence(status)

    @property
    def words(self) -> str:
        """What this host can say in its own favour."""
        longest = f"never silent for longer than {1e-9 * self._silent_ns:.3g} s" if self._silent_ns else "never late"
        return f"this host was {longest}, watchdog {self._watchdog_s:g} s, and no frame was lost"

    @staticmethod
    def _missed(status: Status | None) -> int:
        return 0 if status is None else status.lost_seq + status.bad_frames
