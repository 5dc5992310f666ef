"""System identification for multirotors: flight log in, identified model out.

The public names are loaded when they are first used, so that ``import rotorid`` costs nothing.

Examples
--------
>>> import rotorid
>>> sorted(rotorid.__all__)[:4]
['Channel', 'Finding', 'FlightRecord', 'FrequencyResponse']
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rotorid.data.channel import Channel
    from rotorid.data.findings import Finding
    from rotorid.data.history import TimeHistory
    from rotorid.data.maneuver import Maneuver
    from rotorid.data.record import FlightRecord
    from rotorid.data.response import FrequencyResponse
    from rotorid.errors import InsufficientDataError, LogError, ModelError, RotoridError, UsageError
    from rotorid.io.registry import read
    from rotorid.models.rate import rate_model
    from rotorid.pipeline.identify import identify
    from rotorid.pipeline.inspection import inspect
    from rotorid.pipeline.response import respond
    from rotorid.pipeline.settings import IdentifySettings, ResponseSettings
    from rotorid.report.output import write_results
    from rotorid.signal.clock import one_clock
    from rotorid.signal.segment import find_excitations
    from rotorid.spectral.estimate import frequency_response
    from rotorid.verify.time_domain import verify_in_time

__version__ = "0.1.0"

_HOME = {
    "Channel": "rotorid.data.channel",
    "Finding": "rotorid.data.findings",
    "FlightRecord": "rotorid.data.record",
    "FrequencyResponse": "rotorid.data.response",
    "IdentifySettings": "rotorid.pipeline.settings",
    "InsufficientDataError": "rotorid.errors",
    "LogError": "rotorid.errors",
    "Maneuver": "rotorid.data.maneuver",
    "ModelError": "rotorid.errors",
    "ResponseSettings": "rotorid.pipeline.settings",
    "RotoridError": "rotorid.errors",
    "TimeHistory": "rotorid.data.history",
    "UsageError": "rotorid.errors",
    "find_excitations": "rotorid.signal.segment",
    "frequency_response": "rotorid.spectral.estimate",
    "identify": "rotorid.pipeline.identify",
    "inspect": "rotorid.pipeline.inspection",
    "one_clock": "rotorid.signal.clock",
    "rate_model": "rotorid.models.rate",
    "read": "rotorid.io.registry",
    "respond": "rotorid.pipeline.response",
    "verify_in_time": "rotorid.verify.time_domain",
    "write_results": "rotorid.report.output",
}

__all__ = [
    "Channel",
    "Finding",
    "FlightRecord",
    "FrequencyResponse",
    "IdentifySettings",
    "InsufficientDataError",
    "LogError",
    "Maneuver",
    "ModelError",
    "ResponseSettings",
    "RotoridError",
    "TimeHistory",
    "UsageError",
    "find_excitations",
    "frequency_response",
    "identify",
    "inspect",
    "one_clock",
    "rate_model",
    "read",
    "respond",
    "verify_in_time",
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
