"""Which firmware wrote a DataFlash log, and what follows from that for units and messages.

Units changed between versions: copters before 3.4 logged rates in hundredths of a degree per second, mixer inputs as
parts of 4500 and voltages in hundredths of a volt. The log says which: by its declared units (``FMTU``), its version
(``VER``, ``MSG``), the names of its columns and the type in which a value is stored. The size of values says nothing: a
mixer input of today may well exceed one.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from rotorid.autopilots.ardupilot.firmware import Firmware, named
from rotorid.io.ardupilot.dataflash import Table

_VERSION = re.compile(r"\bV(\d+)\.(\d+)", re.IGNORECASE)
_VEHICLE = re.compile(
    r"\b(?:Ardu|APM[: ]?)(?:Copter|Heli|Plane|Rover|Boat|Sub)|\bAntennaTracker|\bBlimp\b", re.IGNORECASE
)
_NORMALIZED_FROM = (3, 4)
"""From here on rates are deg/s, outputs parts of full scale, voltages volts."""

_WHOLE_NUMBERS = frozenset("bBhHiIqQ")


def firmware_of(tables: Mapping[str, Table]) -> Firmware:
    """The firmware behind the messages ``VER`` and ``MSG``: the text that names vehicle and version, or one of them."""
    texts: list[str] = []
    for name, column in (("VER", "FWS"), ("MSG", "Message")):
        if name in tables and tables[name].holds_text(column):
            texts += [str(text) for text in tables[name].column(column).tolist()]
    tests = (lambda text: introduces(text) and _VERSION.search(text), _VERSION.search, introduces)
    return named(next((text for test in tests for text in texts if test(text)), ""))


def introduces(text: str) -> bool:
    """Whether a text names the firmware of a vehicle.

    Examples
    --------
    >>> introduces("APM:Rover V2.50"), introduces("ArduPlane"), introduces("EKF2 IMU0 is using GPS")
    (True, True, False)
    """
    return _VEHICLE.search(text) is not None


def is_legacy_rate(table: Table, firmware: Firmware) -> bool:
    """Whether ``RATE`` is in centidegrees per second, with mixer inputs as parts of 4500 and throttle as parts of 1000.

    Decided by, in this order: units that the log declares, the names of the columns, the version of the firmware, and
    the clock, which counted milliseconds before 3.3.
    """
    if table.units:
        return False
    if "RllOut" in table:
        return True
    if firmware.copter is not None:
        return firmware.before(_NORMALIZED_FROM)
    return table.clock is not None and table.clock[0] == "TimeMS"


def is_centivolts(table: Table, column: str) -> bool:
    """Whether a voltage is in hundredths of a volt: stored as a whole number, to which the log declares no unit."""
    if column not in table or column in table.units:
        return False
    return table.format.fields[column][1] in _WHOLE_NUMBERS
