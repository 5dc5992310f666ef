"""The plant of an axis, its rate loop, and their margins."""

from rotorid._faces import lazy

__getattr__, __dir__, __all__ = lazy(__name__)
