"""Logs of a bench: motors that move a vehicle which a pivot or a stand holds.

Such a log says what drives the motors, in whatever unit, and how the vehicle turns. Nothing in it could show a flight:
neither thrust nor accelerometer, height or velocity. So what its motors did is no evidence of one.
"""

from __future__ import annotations

import re

from rotorid.data.display import listed
from rotorid.data.record import FlightRecord

_DRIVE = re.compile(r"motor_([1-9][0-9]?)")
_SHOWS_FLIGHT = re.compile(
    r"(roll|pitch|yaw|thrust)_(command|stick|excitation|setpoint_excitation)|a[xyz](_raw|_filtered|_vibration)?"
    r"|[uvw](_dot|_setpoint)?|velocity_.+|(north|east|down)(_setpoint)?|[pqr]_(setpoint|raw|filtered)|hover_thrust"
)
"""Channels of something that flies, or of the controllers with which it would."""
_TURNS = ("phi", "theta", "psi", "p", "q", "r")
_UNIT_WORDS = {"1": "as a share of full output", "V": "in V", "us": "in µs", "rad/s": "in rad/s"}


def driven_motors(record: FlightRecord) -> tuple[str, ...]:
    """Channels ``motor_3`` of what drives single motors, in any unit, in the order of the motors."""
    numbers = sorted(int(match[1]) for name in record.channel_names if (match := _DRIVE.fullmatch(name)))
    return tuple(f"motor_{number}" for number in numbers)


def is_bench(record: FlightRecord) -> bool:
    """Whether a log is of a bench: motors and how the vehicle turns, and nothing with which it could fly.

    A table of motors as shares of full output may also be of a flight, unless it has test inputs of single motors or
    lacks motors in between.

    Examples
    --------
    >>> import numpy as np
    >>> from rotorid.data.record import Channel, Source, Topic
    >>> channels = (Channel(name="motor_3", unit="V"), Channel(name="phi", unit="rad"))
    >>> topic = Topic(name="t", time_s=np.arange(3.0), channels=channels, values=np.zeros((2, 3)))
    >>> is_bench(FlightRecord(source=Source(name="a.csv", format="CSV", sha256=""), topics=(topic,)))
    True
    """
    motors, names, status = driven_motors(record), record.channel_names, record.status
    flags = record.source.firmware or record.parameters or status.in_air is not None or status.armed is not None
    if flags or not motors or not any(name in names for name in _TURNS) or any(map(_SHOWS_FLIGHT.fullmatch, names)):
        return False
    shares = [name for name in motors if record.unit_of(name) == "1"]
    alone = any(name.startswith("motor_") and name.endswith("_excitation") for name in names)
    whole = motors == tuple(f"motor_{number}" for number in range(1, len(motors) + 1))
    return len(shares) < len(motors) or alone or not whole


def bench_words(record: FlightRecord) -> str:
    """Motors and angles of a log of a bench, as a part of a sentence.

    Examples
    --------
    >>> import numpy as np
    >>> from rotorid.data.record import Channel, Source, Topic
    >>> channels = (*(Channel(name=f"motor_{n}", unit="V") for n in (3, 4)), Channel(name="phi", unit="rad"))
    >>> topic = Topic(name="t", time_s=np.arange(3.0), channels=channels, values=np.zeros((3, 3)))
    >>> bench_words(FlightRecord(source=Source(name="a.csv", format="CSV", sha256=""), topics=(topic,)))
    'motor_3 and motor_4 in V, with phi'
    """
    motors = driven_motors(record)
    units = dict.fromkeys(_UNIT_WORDS.get(record.unit_of(name), "") for name in motors)
    turns = [name for name in _TURNS if name in record.channel_names]
    return f"{listed(motors)} {' or '.join(filter(None, units))}, with {listed(turns)}"
