"""One clock for telemetry: seconds since the autopilot booted, from stamps of several widths and from none at all."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from rotorid.data.findings import Finding
from rotorid.io.mavlink import Messages
from rotorid.typing import FloatArray

_UNITS_PER_S = {"time_boot_ms": 1e3, "time_usec": 1e6}
_LARGEST_DELAY_S = 60.0
"""A radio link that is later than this does not exist; a stamp that is, counts from another origin."""


@dataclass(frozen=True, kw_only=True, slots=True)
class BootClock:
    r"""The boot of the autopilot on the clock of the ground station.

    A message that was sent at :math:`t` after the boot is received at :math:`t + t_0 + d` with a delay
    :math:`d \ge 0`; the smallest difference of the two stamps is the best estimate of :math:`t_0`. It assumes that the
    two clocks run equally fast: a drift of 50 ppm is 90 ms in half an hour, which only messages without a stamp feel.

    Parameters
    ----------
    boot_s
        :math:`t_0`, seconds since 1970; the first reception when nothing in the log is stamped.
    restarts
        How often the autopilot began to count anew.
    """

    boot_s: float
    restarts: int = 0

    @classmethod
    def of(cls, messages: Iterable[Messages]) -> BootClock:
        """The clock of messages that carry ``time_boot_ms``."""
        messages = list(messages)
        stamped = [item for item in messages if "time_boot_ms" in (item.fields.dtype.names or ())]
        if not stamped:
            return cls(boot_s=min((float(item.received_us.min()) * 1e-6 for item in messages), default=0.0))
        longest = max(stamped, key=lambda item: item.fields.size)
        booted = [item.received_us * 1e-6 - item.fields["time_boot_ms"] * 1e-3 for item in stamped]
        # A restart takes the count back to zero; packets that overtake one another take it back by less than this.
        steps = np.diff(longest.fields["time_boot_ms"].astype(np.int64))
        return cls(
            boot_s=min(float(item.min()) for item in booted), restarts=int(np.count_nonzero(steps < -_RESTART_MS))
        )

    def stamps(self, messages: Messages) -> FloatArray:
        """Seconds since boot, shape ``(messages,)``: the message's own stamps, or when it was received.

        A stamp of 32 bits in microseconds wraps every 71.6 minutes; the time of reception says how often it did.
        """
        received = messages.received_us * 1e-6 - self.boot_s
        field = next((name for name in _UNITS_PER_S if name in (messages.fields.dtype.names or ())), None)
        if field is None:
            return np.asarray(received, dtype=np.float64)
        own = messages.fields[field] / _UNITS_PER_S[field]
        if field == "time_boot_ms":
            return np.asarray(own, dtype=np.float64)
        if messages.fields.dtype[field].itemsize == 4:
            span = 2.0**32 * 1e-6
            own = own + span * np.round((received - own) / span)
        # Some firmware stamps by the time of day instead of the time since boot.
        foreign = np.abs(received - own) > _LARGEST_DELAY_S
        return np.asarray(np.where(foreign, received, own), dtype=np.float64)

    def findings(self) -> Iterator[Finding]:
        """What to remark about the clock."""
        if self.restarts:
            yield Finding(
                kind="clock_skew",
                severity="warning",
                where="time_boot_ms",
                message=f"The autopilot restarted {self.restarts} times within the log, and its clock with it: stamps "
                "of the parts overlap. Cut the log at the restart and read the parts one by one.",
                numbers={"restarts": self.restarts},
            )


_RESTART_MS = 5_000
