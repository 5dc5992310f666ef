"""Vehicles that results make, and how they fly: simulated, planned, stitched through speeds."""

from rotorid._faces import lazy

__getattr__, __dir__, __all__ = lazy(__name__)
