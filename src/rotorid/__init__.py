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
    from rotorid.data.findings import Finding
    from rotorid.data.flight_plan import FlightPlan, SimulatedFlight
    from rotorid.data.record import Channel, FlightRecord, Maneuver, TimeHistory
    from rotorid.data.response import FrequencyResponse
    from rotorid.errors import InsufficientDataError, LogError, ModelError, RotoridError, UsageError
    from rotorid.io.registry import read, write_log
    from rotorid.models.library import rate_model
    from rotorid.pipeline.identification import identify
    from rotorid.pipeline.inspection import inspect
    from rotorid.pipeline.responses import response
    from rotorid.pipeline.settings import IdentifySettings, ResponseSettings
    from rotorid.report.files import write_results
    from rotorid.signal.clock import resample
    from rotorid.signal.excitations import find_excitations
    from rotorid.simulation.multirotor_flight import fly_multirotor
    from rotorid.simulation.wind import Wind
    from rotorid.spectral.estimate import frequency_response
    from rotorid.vehicles.catalog import aircraft
    from rotorid.verification.time_domain import verify_in_time

__version__ = "0.1.0"

_HOME = {
    "Channel": "rotorid.data.record",
    "Finding": "rotorid.data.findings",
    "FlightPlan": "rotorid.data.flight_plan",
    "FlightRecord": "rotorid.data.record",
    "FrequencyResponse": "rotorid.data.response",
    "IdentifySettings": "rotorid.pipeline.settings",
    "InsufficientDataError": "rotorid.errors",
    "LogError": "rotorid.errors",
    "Maneuver": "rotorid.data.record",
    "ModelError": "rotorid.errors",
    "ResponseSettings": "rotorid.pipeline.settings",
    "RotoridError": "rotorid.errors",
    "SimulatedFlight": "rotorid.data.flight_plan",
    "TimeHistory": "rotorid.data.record",
    "UsageError": "rotorid.errors",
    "Wind": "rotorid.simulation.wind",
    "aircraft": "rotorid.vehicles.catalog",
    "find_excitations": "rotorid.signal.excitations",
    "fly_multirotor": "rotorid.simulation.multirotor_flight",
    "frequency_response": "rotorid.spectral.estimate",
    "identify": "rotorid.pipeline.identification",
    "inspect": "rotorid.pipeline.inspection",
    "resample": "rotorid.signal.clock",
    "rate_model": "rotorid.models.library",
    "read": "rotorid.io.registry",
    "response": "rotorid.pipeline.responses",
    "verify_in_time": "rotorid.verification.time_domain",
    "write_log": "rotorid.io.registry",
    "write_results": "rotorid.report.files",
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
    "rate_model",
    "read",
    "resample",
    "response",
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
