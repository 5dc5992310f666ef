"""Validation of a model on unseen data."""

from rotorid._faces import lazy

__getattr__, __dir__, __all__ = lazy(__name__)
