"""Value objects: frozen, keyword-only, arrays copied in and read-only."""

from rotorid.data.channel import AXES, STANDARD_UNITS, Channel
from rotorid.data.findings import Finding, Severity
from rotorid.data.history import TimeHistory
from rotorid.data.maneuver import Maneuver
from rotorid.data.record import FlightRecord, Source, Topic
from rotorid.data.response import FrequencyResponse

__all__ = [
    "AXES",
    "STANDARD_UNITS",
    "Channel",
    "Finding",
    "FlightRecord",
    "FrequencyResponse",
    "Maneuver",
    "Severity",
    "Source",
    "TimeHistory",
    "Topic",
]
