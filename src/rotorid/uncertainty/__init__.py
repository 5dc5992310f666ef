"""Uncertainty of what was identified."""

from rotorid._faces import lazy

__getattr__, __dir__, __all__ = lazy(__name__)
