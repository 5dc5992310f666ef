"""Steps in order: from records to results."""

from rotorid._faces import lazy

__getattr__, __dir__, __all__ = lazy(__name__)
