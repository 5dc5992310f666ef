"""Test inputs: what is added to a command so that a flight can answer. Pure functions, no vehicle, no data."""

from rotorid._faces import lazy

__getattr__, __dir__, __all__ = lazy(__name__)
