"""Public benchmarks: models of rotorid, predictions of anybody and published errors in one table."""

from rotorid._faces import lazy

__getattr__, __dir__, __all__ = lazy(__name__)
