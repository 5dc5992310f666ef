"""Deprecated: these names are in the packages that ``__init__.pyi`` gives; from here they go in release 0.3."""

import warnings
from typing import Any

from rotorid._faces import lazy

_load, __dir__, __all__ = lazy(__name__)


def __getattr__(name: str) -> Any:
    value = _load(name)
    home = ".".join(value.__module__.split(".")[:2])
    message = f"rotorid.pipeline.{name} is deprecated; import {name} from {home}"
    warnings.warn(message, DeprecationWarning, stacklevel=2)
    return value
