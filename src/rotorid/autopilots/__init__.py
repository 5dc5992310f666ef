"""The autopilots: what is known of each, gathered in one value."""

from rotorid._faces import lazy

__getattr__, __dir__, __all__ = lazy(__name__)
