"""Gains out of measured plants: ``tune`` and its check."""

from rotorid._faces import lazy

__getattr__, __dir__, __all__ = lazy(__name__)
