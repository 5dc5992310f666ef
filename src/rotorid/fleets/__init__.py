"""Many logs into one table: each read and identified once, and what the fleet says of its vehicles."""

from rotorid._faces import lazy

__getattr__, __dir__, __all__ = lazy(__name__)
