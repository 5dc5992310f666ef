"""Value objects: frozen, keyword-only, arrays copied in and read-only."""

from rotorid.data.findings import Finding, Severity
from rotorid.data.record import AXES, STANDARD_UNITS, Channel, FlightRecord, Maneuver, Source, TimeHistory, Topic
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
