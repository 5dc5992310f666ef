"""Known truths: published vehicles with their numbers and sources, and the flight that ships with rotorid."""

from rotorid._faces import lazy

__getattr__, __dir__, __all__ = lazy(__name__)
