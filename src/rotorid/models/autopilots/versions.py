"""Which firmware may have flown: the name in the log is evidence, and so is what the log holds.

A build without tags calls itself by the last tag that it knows, and a fork as it likes. Firmware computes its
controllers alike from one version to the next but at a few of them; between these lies a *generation*. The
candidates of a log are one firmware for each generation. Which of them made the logged commands, the data decide
(:func:`rotorid.flights.controllers.flown_firmware`).
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

from rotorid.autopilots.betaflight.autopilot import BETAFLIGHT
from rotorid.autopilots.firmware import Version, version_of
from rotorid.autopilots.px4.autopilot import PX4
from rotorid.autopilots.px4.versions import firmware_shown
from rotorid.models.autopilots import betaflight, px4
from rotorid.models.autopilots.betaflight_settings import NAMED_BY_NUMBER


class _Generations(NamedTuple):
    """The generations of an autopilot, and how a log shows to which it belongs.

    ``sign`` is a parameter that all of its logs have, ``changes`` are the first versions of all generations but the
    oldest, and ``shown`` gives the name of the firmware as the contents of a log allow it.
    """

    name: str
    sign: str
    changes: tuple[Version, ...]
    shown: Callable[[str, Iterable[str]], str]

    def of(self, firmware: str) -> int:
        """Place of a firmware's generation; without a version it is taken for today's."""
        version = version_of(firmware)
        return len(self.changes) if version is None else bisect_right(self.changes, version)

    def named(self, place: int) -> str:
        """A firmware of a generation."""
        if place == 0:
            major, minor = self.changes[0]
            return f"{self.name} {major}.{minor - 1} or older"
        major, minor = self.changes[place - 1]
        return f"{self.name} {major}.{minor}{' or newer' if place == len(self.changes) else ''}"


def _betaflight_shown(firmware: str, names: Iterable[str]) -> str:
    """The filters of the derivative have other names since 4.3."""
    version, known = version_of(firmware), set(names)
    new = any(name.startswith("dterm_lpf1") for name in known)
    old = any(name.startswith("dterm_lowpass") for name in known)
    if new != old and version is not None and new != (version >= NAMED_BY_NUMBER):
        return "Betaflight 4.3 or newer" if new else "Betaflight 4.2 or older"
    return firmware


_ALL = (
    _Generations(PX4.name, PX4.gain, (px4.ALPHA_SINCE,), firmware_shown),
    _Generations(BETAFLIGHT.name, BETAFLIGHT.gain, betaflight.CHANGES, _betaflight_shown),
)
"""ArduPilot's parameters have another name wherever their meaning changed, so that its version decides nothing."""


def firmware_candidates(
    parameters: Mapping[str, float], *, firmware: str = "", names: Sequence[str] = ()
) -> tuple[str, ...]:
    """Firmware that may have flown, the likeliest first: the one that the log names, if it could hold what it does.

    Parameters
    ----------
    parameters
        As for :func:`rotorid.models.autopilots.reading.axis_controller`.
    firmware
        What the log calls it.
    names
        Topics and fields of the log, ``vehicle_torque_setpoint.xyz``.

    Returns
    -------
    tuple of str
        One name for each generation, which :func:`~rotorid.models.autopilots.reading.axis_controller` takes; the given
        name alone where all versions compute the controller alike.

    Examples
    --------
    >>> parameters = {"MC_ROLLRATE_P": 0.15, "MC_ROLLRATE_D": 0.003, "IMU_DGYRO_CUTOFF": 20.0}
    >>> firmware_candidates(parameters, firmware="PX4 1.11.2")
    ('PX4 1.11.2', 'PX4 1.12 or newer')
    >>> firmware_candidates(parameters, firmware="PX4 1.8.0 (beta)", names=["actuator_motors.control"])
    ('PX4 1.13 or newer', 'PX4 1.8.0 (beta)')
    """
    own = next((generations for generations in _ALL if generations.sign in parameters), None)
    if own is None:
        return (firmware,)
    likeliest = own.shown(firmware, (*names, *parameters))
    found = {own.of(likeliest): likeliest}
    found.setdefault(own.of(firmware), firmware)
    for place in range(len(own.changes) + 1):
        found.setdefault(place, own.named(place))
    return tuple(found.values())
