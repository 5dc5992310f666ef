"""System identification for multirotors: flight log in, identified model out.

The public names are loaded when they are first used, so that ``import rotorid`` costs nothing.

Examples
--------
>>> import rotorid
>>> sorted(rotorid.__all__)[:4]
['Channel', 'Finding', 'FlightPlan', 'FlightRecord']
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rotorid.data.channel import Channel
    from rotorid.data.findings import Finding
    from rotorid.data.flight_plan import FlightPlan
    from rotorid.data.history import TimeHistory
    from rotorid.data.maneuver import Maneuver
    from rotorid.data.record import FlightRecord
    from rotorid.data.response import FrequencyResponse
    from rotorid.data.simulated_flight import SimulatedFlight
    from rotorid.errors import InsufficientDataError, LogError, ModelError, RotoridError, UsageError
    from rotorid.io.registry import read
    from rotorid.io.write_log import write_log
    from rotorid.models.rate import rate_model
    from rotorid.pipeline.identify import identify
    from rotorid.pipeline.inspection import inspect
    from rotorid.pipeline.response import respond
    from rotorid.pipeline.settings import IdentifySettings, ResponseSettings
    from rotorid.report.output import write_results
    from rotorid.signal.clock import one_clock
    from rotorid.signal.segment import find_excitations
    from rotorid.simulate.multirotor_flight import fly_multirotor
    from rotorid.simulate.wind import Wind
    from rotorid.spectral.estimate import frequency_response
    from rotorid.vehicles.catalog import aircraft
    from rotorid.verify.time_domain import verify_in_time

__version__ = "0.1.0"

_HOME = {
    "Channel": "rotorid.data.channel",
    "Finding": "rotorid.data.findings",
    "FlightPlan": "rotorid.data.flight_plan",
    "FlightRecord": "rotorid.data.record",
    "FrequencyResponse": "rotorid.data.response",
    "IdentifySettings": "rotorid.pipeline.settings",
    "InsufficientDataError": "rotorid.errors",
    "LogError": "rotorid.errors",
    "Maneuver": "rotorid.data.maneuver",
    "ModelError": "rotorid.errors",
    "ResponseSettings": "rotorid.pipeline.settings",
    "RotoridError": "rotorid.errors",
    "SimulatedFlight": "rotorid.data.simulated_flight",
    "TimeHistory": "rotorid.data.history",
    "UsageError": "rotorid.errors",
    "Wind": "rotorid.simulate.wind",
    "aircraft": "rotorid.vehicles.catalog",
    "find_excitations": "rotorid.signal.segment",
    "fly_multirotor": "rotorid.simulate.multirotor_flight",
    "frequency_response": "rotorid.spectral.estimate",
    "identify": "rotorid.pipeline.identify",
    "inspect": "rotorid.pipeline.inspection",
    "one_clock": "rotorid.signal.clock",
    "rate_model": "rotorid.models.rate",
    "read": "rotorid.io.registry",
    "respond": "rotorid.pipeline.response",
    "verify_in_time": "rotorid.verify.time_domain",
    "write_log": "rotorid.io.write_log",
    "write_results": "rotorid.report.output",
}

__all__ = [
    "Channel",
    "Finding",
    "FlightPlan",
    "FlightRecord",
    "FrequencyResponse",
    "IdentifySettings",
    "InsufficientDataError",
    "LogError",
    "Maneuver",
    "ModelError",
    "ResponseSettings",
    "RotoridError",
    "SimulatedFlight",
    "TimeHistory",
    "UsageError",
    "Wind",
    "aircraft",
    "find_excitations",
    "fly_multirotor",
    "frequency_response",
    "identify",
    "inspect",
    "one_clock",
    "rate_model",
    "read",
    "respond",
    "verify_in_time",
    "write_log",
    "write_results",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'rotorid' has no attribute {name!r}")
    value = getattr(import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
