"""Many logs into one table: each read and identified once, then compared over the fleet."""

from rotorid._faces import lazy

__getattr__, __dir__, __all__ = lazy(__name__)
