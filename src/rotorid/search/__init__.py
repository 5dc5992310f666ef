"""Global search: many starts, populations, patterns; every one ends in a local search and keeps all minima."""

from rotorid._faces import lazy

__getattr__, __dir__, __all__ = lazy(__name__)
