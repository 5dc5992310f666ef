"""Self-contained pages: about a log, about measured responses, about identifications."""

from rotorid._faces import lazy

__getattr__, __dir__, __all__ = lazy(__name__)
